#include "interflect/device/registry.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/cuda/cuda.h"
#include "interflect/device/opencl/opencl.h"
#include "interflect/device/openmp/openmp.h"
#include "interflect/device/vulkan/vulkan.h"

// The only file that names all backends. A new one is a line of `backends`.

namespace interflect {

namespace {

struct NamedBackend {
  std::string_view name;  ///< what its ids start with
  std::vector<DeviceEntry> (*list)();
  std::unique_ptr<Device> (*open)(std::uint32_t index);  ///< index: the place in list()
};

/// In the order in which `auto` prefers them.
constexpr NamedBackend backends[] = {
    {"cuda", &cuda::list_devices, &cuda::open_device},
    {"opencl", &opencl::list_devices, &opencl::open_device},
    {"vulkan", &vulkan::list_devices, &vulkan::open_device},
    {"openmp", &openmp::list_devices, &openmp::open_device},
};

/// The backend's device of that id; null when it has none of that id ("auto": none that is available).
std::unique_ptr<Device> find(const NamedBackend& backend, std::string_view id) {
  std::uint32_t index = 0;
  for (const DeviceEntry& entry : backend.list()) {
    if (entry.info.id == id && !entry.available) throw device_error(id, "open", entry.reason);
    const bool wanted = entry.info.id == id || (id == "auto" && !entry.info.emulated());
    if (entry.available && wanted) return backend.open(index);
    ++index;
  }
  return nullptr;
}

}  // namespace

std::vector<DeviceEntry> list_devices() {
  std::vector<DeviceEntry> all;
  for (const NamedBackend& backend : backends) {
    for (DeviceEntry& entry : backend.list()) all.push_back(std::move(entry));
  }
  return all;
}

std::unique_ptr<Device> open_device(std::string_view id) {
  const std::string_view asked = id.substr(0, id.find(':'));
  for (const NamedBackend& backend : backends) {
    if (asked != backend.name && id != "auto") continue;  // drivers that nobody asked for stay asleep
    if (std::unique_ptr<Device> device = find(backend, id)) return device;
  }
  std::vector<std::string> valid = {"auto"};
  for (const DeviceEntry& entry : list_devices()) valid.push_back(entry.info.id);
  throw Error(ErrorKind::usage, fmt::format("no device '{}'; there are {}", id, fmt::join(valid, ", ")));
}

}  // namespace interflect
