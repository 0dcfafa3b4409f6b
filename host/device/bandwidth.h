#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "interflect/device/device.h"

namespace interflect {

/// One measured rate of a device, verified or with the reason why it is not.
struct Rate {
  std::string what;         ///< "read" or "copy"
  std::uint64_t bytes = 0;  ///< moved per repetition: read, or read and written
  double seconds = 0;       ///< the median of the repetitions, enqueue to end
  double seconds_min = 0;
  double seconds_max = 0;
  bool verified = false;
  std::string reason;  ///< why not verified
  [[nodiscard]] double gb_per_s() const { return seconds > 0 ? static_cast<double>(bytes) / seconds * 1e-9 : 0; }
};

/// Seconds of one pass of the read kernel over the buffer's whole 64-byte lines, with `streams` (1, 2, 4 or 8) read
/// side by side where the device can choose. `sums`, when given, receives each group's sum. Throws what the device
/// throws.
[[nodiscard]] double time_read(Device& device, Buffer& data, int streams, std::vector<float>* sums = nullptr);

/// The read bandwidth over a buffer that is there already (a panel of F): the stream count with the best median of
/// `repetitions` passes, after one to warm up. Verified when all passes gave the same sums and no sum is NaN.
[[nodiscard]] Rate read_bandwidth(Device& device, Buffer& data, int repetitions);

/// Read and copy bandwidth over buffers of `bytes` made for it (much larger than any cache, 256 MiB at least, to mean
/// anything), each the median of `repetitions`. Sums and copy are compared with what was put in.
[[nodiscard]] std::vector<Rate> measure_bandwidth(Device& device, std::uint64_t bytes, int repetitions);

}  // namespace interflect
