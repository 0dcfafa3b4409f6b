#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bench_launch.h"
#include "bench_row.h"
#include "measurement.h"

namespace interflect::cli {

/// Appends a row for every vector kernel of kernels/README.md that a solver runs over its vectors: dot, axpby, bounce,
/// cg_product, cg_step, bicgstab_product, bicgstab_half, bicgstab_step; over columns of a million elements, so many
/// that no cache holds them, with `bytes` as the contract states the traffic. Each is held against the fp64 reference,
/// element by element, within the contract's bound. `device` must be open.
void add_vector_kernels(std::vector<Measurement>& all, const SharedDevice& device);

}  // namespace interflect::cli
