#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/device/device.h"

namespace interflect {

/// A device that a backend knows of, usable or not.
struct DeviceEntry {
  DeviceInfo info;
  bool available = false;
  std::string reason;  ///< why not, when not available
};

/// Every device of every backend of this build, in the order in which `auto` prefers them.
[[nodiscard]] std::vector<DeviceEntry> list_devices();

/// Opens a device by id; "auto" opens the first of choose_devices("auto") that can be opened. Throws a usage Error that
/// lists the valid ids for an unknown one, a device Error for one that is there but cannot be opened.
[[nodiscard]] std::unique_ptr<Device> open_device(std::string_view id);

/// The devices that "auto", "all", an id or several ("cuda:0,opencl:1,openmp") mean, in their order; none is opened for
/// an id, and only the backends that are named are asked. "all": of each piece of hardware the device that `auto`
/// prefers, none of those that run GPU kernels on the processor. Throws a usage Error that lists the valid ids for an
/// unknown or empty one, and for one that is named twice. Never empty.
[[nodiscard]] std::vector<std::string> choose_devices(std::string_view text);

/// What `auto` makes of a list: the available devices that are real accelerators, then openmp. Devices with the same
/// `hardware` are one piece, in the order of the list; with more than one piece the faster comes first by `rate` (read
/// bandwidth, 0 when it could not be measured), which is asked only then, once per piece: for its first device that
/// has one. Drivers that run GPU kernels on the processor are left out.
[[nodiscard]] std::vector<std::string> rank_devices(std::span<const DeviceEntry> entries,
                                                    const std::function<double(const DeviceEntry&)>& rate);

/// What `all` makes of a list: of rank_devices() the first of each piece of hardware.
[[nodiscard]] std::vector<std::string> all_devices(std::span<const DeviceEntry> entries,
                                                   const std::function<double(const DeviceEntry&)>& rate);

/// A backend as the registry sees it.
struct Backend {
  std::string name;  ///< what its ids start with
  std::function<std::vector<DeviceEntry>()> list;
  std::function<std::unique_ptr<Device>(std::uint32_t index)> open;  ///< index: the place in list()
};

/// The functions above for any set of backends. A backend whose driver nobody asked for stays asleep.
class Registry {
 public:
  explicit Registry(std::vector<Backend> backends) : backends_(std::move(backends)) {}

  [[nodiscard]] std::vector<DeviceEntry> list() const;
  [[nodiscard]] std::unique_ptr<Device> open(std::string_view id) const;
  [[nodiscard]] std::vector<std::string> choose(std::string_view text) const;

 private:
  [[nodiscard]] const Backend* backend_of(std::string_view id) const;
  [[nodiscard]] bool knows(std::string_view id) const;
  [[noreturn]] void refuse_unknown(std::string_view id) const;

  std::vector<Backend> backends_;
};

}  // namespace interflect
