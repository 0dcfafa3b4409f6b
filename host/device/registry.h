#pragma once

#include <memory>
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

/// Opens a device by id, or "auto". Throws a usage Error that lists the valid ids for an unknown one, a device Error
/// for one that is there but cannot be opened.
[[nodiscard]] std::unique_ptr<Device> open_device(std::string_view id);

}  // namespace interflect
