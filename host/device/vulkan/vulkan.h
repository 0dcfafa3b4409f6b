#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/device/registry.h"

// The Vulkan backend: compute through the Vulkan loader on any device of version 1.1, with no extension required.
// Kernels are kernels/glsl/*.comp, compiled by glslang in the process.
//
// The environment can say:
//   INTERFLECT_VULKAN_SHAPE       cpu or gpu: how kernels are cut and memory is used, else chosen by device properties.
//                                 cpu: work-groups of one subgroup, matrix and vectors read as texel buffers.
//                                 gpu: work-groups of 256, storage buffers, memory reached by staging copies.
//   INTERFLECT_VULKAN_SUBGROUP    the subgroup size, where the device lets choose; 0: shared memory instead of
//                                 subgroup operations.
//   INTERFLECT_VULKAN_VALIDATION  1: under the Khronos validation layer with synchronisation validation. Any warning or
//                                 error of it, also of an object that was left behind when its device went, is a
//                                 device Error of the next wait() or download() of any device.
// A value that is not one of these, or that the device cannot, is a device Error.

namespace interflect::vulkan {

/// Every device that it sees, "vulkan:0" and so on, and what keeps it from seeing any.
[[nodiscard]] std::vector<DeviceEntry> list_devices();
/// Opens list_devices()[index]. Throws a device Error.
[[nodiscard]] std::unique_ptr<interflect::Device> open_device(std::uint32_t index);

}  // namespace interflect::vulkan
