#pragma once

#include <cstdint>
#include <string>

namespace interflect {

/// What one of several devices did of the products F x.
struct DeviceShare {
  std::string device;           ///< id
  double share = 0;             ///< of the bytes of F, at last
  std::uint64_t bytes = 0;      ///< of F, at last
  double bytes_per_second = 0;  ///< of F, in all its products together; 0 before the first
  double busy_seconds = 0;      ///< its own part of the products, with sending x and fetching y
  double idle_seconds = 0;      ///< the rest of the time that the parts took together
  std::uint32_t moves = 0;      ///< how often F was cut anew, for all devices
};

/// A device that a solve gave up, and why.
struct DeviceFailure {
  std::string device;  ///< id
  std::string reason;  ///< the Error's text; a compiler's log makes it several lines
};

}  // namespace interflect
