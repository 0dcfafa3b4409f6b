#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/device/registry.h"

// The OpenMP backend: the processor's own cores and memory. Kernels are the C++ functions of kernels/omp/, launches run
// at once. As many threads as OMP_NUM_THREADS says, else one per core; threads are never pinned (every other pool in
// the process would inherit the one core).

namespace interflect::openmp {

/// The one device "openmp".
[[nodiscard]] std::vector<DeviceEntry> list_devices();
/// Opens it; `index` is always 0.
[[nodiscard]] std::unique_ptr<interflect::Device> open_device(std::uint32_t index);

}  // namespace interflect::openmp
