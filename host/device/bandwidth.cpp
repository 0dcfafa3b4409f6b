#include "interflect/device/bandwidth.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/kernel_arguments.h"

namespace interflect {

namespace {

constexpr std::uint64_t line_bytes = 64;
// A processor's work-group is a long stream, 4 MiB: a sum of ones is exact in fp32. A GPU wants thousands of them.
constexpr std::uint32_t lines_per_cpu_group = 65536, lines_per_gpu_group = 1024;

std::uint32_t lines_in(const Buffer& buffer) {
  const std::uint64_t lines = buffer.size() / line_bytes;
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(lines, std::numeric_limits<std::uint32_t>::max()));
}

std::span<const std::byte> bytes_of(const StreamArguments& arguments) {
  return std::as_bytes(std::span(&arguments, 1));
}

Rate rate_of(std::string what, std::uint64_t bytes, std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  return {.what = std::move(what),
          .bytes = bytes,
          .seconds = seconds[seconds.size() / 2],
          .seconds_min = seconds.front(),
          .seconds_max = seconds.back(),
          .verified = true,
          .reason = ""};
}

void deny(Rate& rate, std::string reason) {
  rate.verified = false;
  rate.reason = std::move(reason);
}

Rate copy_bandwidth(Device& device, Buffer& from, Buffer& to, int repetitions, float value) {
  const StreamArguments arguments{lines_in(from)};
  const std::unique_ptr<Kernel> kernel = device.kernel("copy", {});
  Buffer* const buffers[] = {&from, &to};
  const std::uint32_t groups = stream_groups(device.info(), arguments.lines);
  std::vector<double> seconds;
  for (int i = 0; i <= repetitions; ++i) {
    const Timer timer;
    device.queue().launch(*kernel, groups, buffers, bytes_of(arguments), "Measure copying");
    device.queue().wait();
    if (i > 0) seconds.push_back(timer.seconds());
  }
  Rate rate = rate_of("copy", 2 * line_bytes * arguments.lines, std::move(seconds));
  if (!filled_with(device, to, value)) deny(rate, "the copy differs from what was copied");
  return rate;
}

void check_repetitions(int repetitions) {
  if (repetitions < 1) throw Error(ErrorKind::usage, "a bandwidth needs at least one repetition");
}

}  // namespace

std::uint32_t stream_groups(const DeviceInfo& device, std::uint32_t lines) {
  const std::uint64_t per_group = device.type == DeviceType::gpu ? lines_per_gpu_group : lines_per_cpu_group;
  const std::uint64_t groups = (lines + per_group - 1) / per_group;
  return static_cast<std::uint32_t>(std::clamp<std::uint64_t>(groups, 1, device.max_groups));
}

Reader::Reader(Device& device, const std::vector<Buffer*>& buffers, int streams)
    : device_(device), kernel_(device.kernel("read", {{"STREAMS", streams}})) {
  for (Buffer* buffer : buffers) {
    const std::uint32_t lines = lines_in(*buffer);
    const std::uint32_t groups = stream_groups(device.info(), lines);
    parts_.push_back({buffer, lines, groups, device.allocate(groups * sizeof(float))});
    bytes_ += line_bytes * lines;
  }
}

double Reader::seconds() {
  const Timer timer;
  for (const Part& part : parts_) {
    Buffer* const buffers[] = {part.data, part.sums.get()};
    const StreamArguments arguments{part.lines};
    device_.queue().launch(*kernel_, part.groups, buffers, bytes_of(arguments), "Measure reading");
  }
  device_.queue().wait();
  return timer.seconds();
}

std::vector<float> Reader::sums() {
  std::vector<float> all;
  for (const Part& part : parts_) {
    std::vector<float> values(part.groups);
    device_.queue().download(*part.sums, 0, std::as_writable_bytes(std::span(values)));
    all.insert(all.end(), values.begin(), values.end());
  }
  return all;
}

double Reader::bound() const {
  std::uint32_t most = 0;
  for (const Part& part : parts_) most = std::max(most, (part.lines + part.groups - 1) / part.groups);
  const double rounding = (most + 40.0) * 0x1p-24;
  return rounding / (1 - rounding);
}

void fill(Device& device, Buffer& buffer, float value) {
  const std::vector<float> chunk((std::size_t{16} << 20) / sizeof(float), value);
  const std::span<const std::byte> all = std::as_bytes(std::span(chunk));
  for (std::size_t done = 0; done < buffer.size(); done += all.size()) {
    device.queue().upload(buffer, done, all.first(std::min(all.size(), buffer.size() - done)));
  }
}

bool filled_with(Device& device, const Buffer& buffer, float value) {
  std::vector<float> chunk((std::size_t{16} << 20) / sizeof(float));
  const std::span<std::byte> all = std::as_writable_bytes(std::span(chunk));
  for (std::size_t done = 0; done < buffer.size(); done += all.size()) {
    const std::size_t bytes = std::min(all.size(), buffer.size() - done);
    device.queue().download(buffer, done, all.first(bytes));
    const auto end = chunk.begin() + static_cast<std::ptrdiff_t>(bytes / sizeof(float));
    if (std::any_of(chunk.begin(), end, [&](float x) { return x != value; })) return false;
  }
  return true;
}

double time_read(Device& device, Buffer& data, int streams, std::vector<float>* sums) {
  Reader reader(device, {&data}, streams);
  const double seconds = reader.seconds();
  if (sums != nullptr) *sums = reader.sums();
  return seconds;
}

Rate read_bandwidth(Device& device, Buffer& data, int repetitions) {
  check_repetitions(repetitions);
  Rate best;
  for (const int streams : reader_streams) {
    Reader reader(device, {&data}, streams);
    static_cast<void>(reader.seconds());  // warm up
    const std::vector<float> first = reader.sums();
    bool same = std::none_of(first.begin(), first.end(), [](float sum) { return std::isnan(sum); });
    std::vector<double> seconds;
    for (int i = 0; i < repetitions; ++i) {
      seconds.push_back(reader.seconds());
      const std::vector<float> again = reader.sums();
      same = same && std::memcmp(first.data(), again.data(), first.size() * sizeof(float)) == 0;
    }
    Rate rate = rate_of("read", line_bytes * lines_in(data), std::move(seconds));
    if (!same) deny(rate, "two passes over the same memory gave different sums");
    if (best.what.empty() || !rate.verified || (best.verified && rate.seconds < best.seconds)) best = rate;
  }
  return best;
}

namespace {

/// read_bandwidth() over a buffer of ones, with their number held against the sums.
Rate read_of_ones(Device& device, Buffer& ones, int repetitions) {
  Rate rate = read_bandwidth(device, ones, repetitions);
  std::vector<float> sums;
  static_cast<void>(time_read(device, ones, 8, &sums));
  double total = 0;
  for (const float sum : sums) total += static_cast<double>(sum);
  const std::uint64_t put_in = ones.size() / sizeof(float);
  if (total != static_cast<double>(put_in)) deny(rate, "the sums are not those of what was put in");
  return rate;
}

}  // namespace

std::vector<Rate> measure_bandwidth(Device& device, std::uint64_t bytes, int repetitions) {
  check_repetitions(repetitions);
  if (bytes < line_bytes || bytes % line_bytes != 0 || bytes / line_bytes > 0xFFFFFFFFU) {
    throw Error(ErrorKind::usage, "a bandwidth is measured over a whole number of 64-byte lines, 1 to 2^32 - 1");
  }
  const std::unique_ptr<Buffer> from = device.allocate(bytes);
  const std::unique_ptr<Buffer> to = device.allocate(bytes);
  fill(device, *from, 1);
  fill(device, *to, 0);  // its pages are there before the clock runs
  std::vector<Rate> rates = {read_of_ones(device, *from, repetitions)};
  rates.push_back(copy_bandwidth(device, *from, *to, repetitions, 1));
  return rates;
}

Rate quick_read_bandwidth(Device& device) {
  constexpr std::uint64_t wanted = std::uint64_t{128} << 20;
  const std::unique_ptr<Buffer> ones = device.allocate(measurable_bytes(device.info(), wanted));
  fill(device, *ones, 1);
  return read_of_ones(device, *ones, 3);
}

std::uint64_t measurable_bytes(const DeviceInfo& info, std::uint64_t wanted) {
  std::uint64_t bytes = std::min(wanted, std::uint64_t{info.max_groups} * lines_per_cpu_group * line_bytes);
  if (info.max_buffer_bytes != 0) bytes = std::min(bytes, info.max_buffer_bytes);
  if (info.memory_bytes != 0) bytes = std::min(bytes, info.memory_bytes / 4);
  return std::max(line_bytes, bytes / line_bytes * line_bytes);
}

}  // namespace interflect
