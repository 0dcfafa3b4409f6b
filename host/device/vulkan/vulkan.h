#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/device/registry.h"

// The Vulkan backend.

namespace interflect::vulkan {

/// Every device that it sees, "vulkan:0" and so on, and what keeps it from seeing any.
[[nodiscard]] std::vector<DeviceEntry> list_devices();
/// Opens list_devices()[index]. Throws a device Error.
[[nodiscard]] std::unique_ptr<interflect::Device> open_device(std::uint32_t index);

}  // namespace interflect::vulkan
