#include "interflect/device/opencl/opencl.h"

#include "interflect/base/error.h"

namespace interflect::opencl {

std::vector<DeviceEntry> list_devices() {
  return {};
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t /*index*/) {
  throw device_error("opencl", "open", "there is no such device");
}

}  // namespace interflect::opencl
