#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "interflect/device/device.h"

namespace interflect {

/// The work-groups with which `read` and `copy` go over so many lines: long streams on a processor, thousands of groups
/// on a GPU.
[[nodiscard]] std::uint32_t stream_groups(const DeviceInfo& device, std::uint32_t lines);

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

/// The read kernel over buffers that are there already (the panels of F), compiled and with its sums allocated once, so
/// that it can be timed again and again. The buffers must outlive it.
class Reader {
 public:
  /// Over each buffer's whole 64-byte lines, with `streams` (1, 2, 4 or 8) read side by side where the device can
  /// choose. Throws what the device throws.
  Reader(Device& device, const std::vector<Buffer*>& buffers, int streams);

  /// One pass over all buffers, enqueue to end.
  [[nodiscard]] double seconds();
  /// Each group's sum, buffer after buffer, as the last pass left them.
  [[nodiscard]] std::vector<float> sums();
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }  ///< read in a pass
  /// The relative error that kernels/README.md allows to the sum of values of one sign.
  [[nodiscard]] double bound() const;

 private:
  struct Part {
    Buffer* data;
    std::uint32_t lines, groups;
    std::unique_ptr<Buffer> sums;
  };
  Device& device_;
  std::unique_ptr<Kernel> kernel_;
  std::vector<Part> parts_;
  std::uint64_t bytes_ = 0;
};

/// The stream counts that are worth a try: the best one differs from device to device.
inline constexpr int reader_streams[] = {1, 2, 4, 8};

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

/// The read half of that over 128 MiB, or what the device's limits leave of it, in a few passes: quick enough for a
/// list of devices, and good enough to tell the faster of two.
[[nodiscard]] Rate quick_read_bandwidth(Device& device);

/// How many of `wanted` bytes a buffer for measuring may have: whole 64-byte lines within the device's largest buffer,
/// a quarter of its memory, and its work-groups.
[[nodiscard]] std::uint64_t measurable_bytes(const DeviceInfo& info, std::uint64_t wanted);

/// Fills a buffer with one value.
void fill(Device& device, Buffer& buffer, float value);
/// Whether every element of the buffer is `value`.
[[nodiscard]] bool filled_with(Device& device, const Buffer& buffer, float value);

}  // namespace interflect
