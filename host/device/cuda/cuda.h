#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/device/registry.h"

// The CUDA backend: NVIDIA's GPUs through the driver API (libcuda.so.1) and NVRTC 12 or newer, both opened at run time;
// INTERFLECT_NVRTC names the latter's library. Kernels are those of kernels/cuda/, compiled for the device's own
// architecture; launches go into one stream, those that repeat as a CUDA graph (launches.h), transfers through pinned
// memory.

namespace interflect::cuda {

/// Every device that it sees, "cuda:0" and so on; where it sees none, one entry "cuda:0" that says why.
[[nodiscard]] std::vector<DeviceEntry> list_devices();
/// Opens list_devices()[index]. Throws a device Error.
[[nodiscard]] std::unique_ptr<interflect::Device> open_device(std::uint32_t index);

}  // namespace interflect::cuda
