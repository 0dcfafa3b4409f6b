#pragma once

#include <string_view>
#include <vector>

#include "interflect/device/check.h"

namespace interflect::check {

/// The kernels of the assembly (tile_kinds ... tile_store) on a device against the fp64 reference: S of pairs of every
/// kind without anything between them, and what shadow rays hide against brute force in double precision, with the same
/// samples. A row's error is the largest |S_ij - reference| / min(A_i, A_j). `only` (a case's name, "near"): that one
/// alone; empty: all. A device whose S comes from Embree (openmp) gets one row, unsupported. As check_device() throws
/// nothing of the device's.
void check_assembly(Device& device, std::vector<KernelCheck>& rows, std::string_view only = {});

}  // namespace interflect::check
