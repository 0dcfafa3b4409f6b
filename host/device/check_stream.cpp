#include <fmt/format.h>

#include <cmath>

#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"

// read and copy: what they sum and copy, so that a measured bandwidth is that of real work.

namespace interflect::check {

namespace {

std::uint64_t seed_of(std::uint32_t lines) {
  return std::uint64_t{lines} * 2246822519U + 1;
}

Finding run_read(Device& device, std::uint32_t lines, std::uint32_t groups, int streams) {
  const std::vector<float> data = Random(seed_of(lines)).numbers(std::size_t{lines} * 16);
  const GuardedBuffer from(device, data);
  const GuardedBuffer sums(device, std::vector<float>(groups, sentinel()));
  const auto kernel = device.kernel("read", {{"STREAMS", streams}});
  const StreamArguments arguments{lines};
  Buffer* const buffers[] = {from.get(), sums.get()};
  device.queue().launch(*kernel, groups, buffers, std::as_bytes(std::span(&arguments, 1)), "Check read");
  const std::vector<float> found = sums.values(device);
  Finding finding;
  for (std::uint64_t g = 0; g < groups; ++g) {
    double sum = 0;
    double magnitude = 0;
    for (std::uint64_t i = lines * g / groups * 16; i < lines * (g + 1) / groups * 16; ++i) {
      sum += static_cast<double>(data[i]);
      magnitude += std::abs(static_cast<double>(data[i]));
    }
    compare(finding, found[g], sum, magnitude);
  }
  return finding;
}

Finding run_copy(Device& device, std::uint32_t lines) {
  const std::vector<float> data = Random(seed_of(lines)).numbers(std::size_t{lines} * 16);
  const GuardedBuffer from(device, data);
  const GuardedBuffer to(device, std::vector<float>(data.size(), sentinel()));
  const auto kernel = device.kernel("copy", {});
  const StreamArguments arguments{lines};
  Buffer* const buffers[] = {from.get(), to.get()};
  device.queue().launch(*kernel, 3, buffers, std::as_bytes(std::span(&arguments, 1)), "Check copy");
  const std::vector<float> found = to.values(device);
  Finding finding;
  for (std::size_t i = 0; i < data.size(); ++i) compare(finding, found[i], data[i], 1);
  return finding;
}

}  // namespace

void check_stream(Device& device, std::vector<KernelCheck>& rows, const Selection& selection) {
  for (const std::uint32_t lines : {1U, 2U, 7U, 16U, 17U, 255U, 1000U}) {
    if (lines > selection.max_size) continue;
    for (const int streams : {1, 2, 4, 8}) {
      for (const std::uint32_t groups : {1U, 3U}) {
        KernelCheck row;
        row.kernel = "read";
        row.parameters = fmt::format("STREAMS={} groups={} seed={}", streams, groups, seed_of(lines));
        row.size = lines;
        row.bound = rounding_bound(lines + 40);
        add_case(rows, std::move(row), [&] { return run_read(device, lines, groups, streams); });
      }
    }
    KernelCheck row;
    row.kernel = "copy";
    row.parameters = fmt::format("seed={}", seed_of(lines));
    row.size = lines;
    row.bound = 0;
    add_case(rows, std::move(row), [&] { return run_copy(device, lines); });
  }
}

}  // namespace interflect::check
