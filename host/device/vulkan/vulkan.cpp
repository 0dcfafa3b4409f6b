#include "interflect/device/vulkan/vulkan.h"

#include "interflect/base/error.h"

namespace interflect::vulkan {

std::vector<DeviceEntry> list_devices() {
  return {};
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t /*index*/) {
  throw device_error("vulkan", "open", "there is no such device");
}

}  // namespace interflect::vulkan
