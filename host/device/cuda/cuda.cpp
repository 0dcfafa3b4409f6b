#include "interflect/device/cuda/cuda.h"

#include "interflect/base/error.h"

namespace interflect::cuda {

std::vector<DeviceEntry> list_devices() {
  return {};
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t /*index*/) {
  throw device_error("cuda", "open", "there is no such device");
}

}  // namespace interflect::cuda
