#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/vector_reference.h"

// The vector kernels: every element of every buffer against the reference, and what a kernel does not write by its
// bits.

namespace interflect::check {

namespace {

// Each column takes its own way through a kernel: 0 goes on, 1 restarts, 2 has converged, 3 has a curvature below zero.
constexpr std::uint32_t columns = 4;

struct Case {
  std::string_view kernel;
  VectorArguments arguments;
  std::uint64_t seed = 0;
};

std::uint32_t blocks_of(std::uint32_t n) {
  return (n + reduction_block - 1) / reduction_block;
}

std::vector<float> vector_of(Random& random, const VectorArguments& a) {
  std::vector<float> all;
  for (std::uint32_t c = 0; c < a.columns; ++c) {
    std::vector<float> column = random.numbers(a.n);
    column.resize(a.vector_stride, sentinel());
    all.insert(all.end(), column.begin(), column.end());
  }
  return all;
}

/// Positive sums, so that the scalars from them are well conditioned, and slots that lead each column its way.
std::vector<float> sums_of(Random& random, const VectorArguments& a) {
  std::vector<float> sums = random.numbers(sums_size(a.columns, a.blocks));
  for (float& value : sums) value = std::abs(value);
  const auto set = [&](std::uint32_t slot, std::uint32_t column, float value) {
    sums[slot * a.columns + column] = value;
  };
  for (std::uint32_t c = 0; c < a.columns; ++c) {
    set(slot::target, c, c == 2 ? 1e6F : 1e-3F);
    set(slot::cg_shift, c, c == 3 ? 1e4F : 0.125F);
    if (c == 1) {
      set(slot::alpha, c, 0);
      set(slot::bicgstab_rho, c, 0);
    }
    if (c == 2) set(slot::cg_gamma, c, 0);
  }
  return sums;
}

reference::Numbers numbers_of(const std::vector<float>& values) {
  reference::Numbers numbers;
  numbers.reserve(values.size());
  for (const float value : values) numbers.emplace_back(static_cast<double>(value));
  return numbers;
}

void compare_buffer(Finding& finding, std::size_t buffer, const std::vector<float>& before,
                    const std::vector<float>& after, const reference::Numbers& exact) {
  for (std::size_t i = 0; i < exact.size(); ++i) {
    if (exact[i].written) {
      compare(finding, after[i], exact[i].value, std::max(exact[i].magnitude, 1e-30));
    } else if (std::bit_cast<std::uint32_t>(before[i]) != std::bit_cast<std::uint32_t>(after[i])) {
      finding.wrong = fmt::format("float {} of buffer {} is not to be written, but was", i, buffer);
    }
  }
}

Finding run(Device& device, const Case& test) {
  Random random(test.seed);
  std::vector<std::vector<float>> before;
  for (std::size_t k = 0; k < reference::vectors_of(test.kernel); ++k)
    before.push_back(vector_of(random, test.arguments));
  before.push_back(sums_of(random, test.arguments));

  std::vector<GuardedBuffer> guarded;
  std::vector<Buffer*> buffers;
  std::vector<reference::Numbers> exact;
  for (const std::vector<float>& values : before) {
    guarded.emplace_back(device, values);
    buffers.push_back(guarded.back().get());
    exact.push_back(numbers_of(values));
  }
  const auto kernel = device.kernel(test.kernel, {});
  const std::uint32_t items = columns * test.arguments.blocks;
  const std::uint32_t groups = (items + test.arguments.blocks_per_group - 1) / test.arguments.blocks_per_group;
  device.queue().launch(*kernel, groups, buffers, std::as_bytes(std::span(&test.arguments, 1)), "Check vectors");

  reference::vector_kernel(test.kernel, test.arguments, exact);
  Finding finding;
  for (std::size_t k = 0; k < guarded.size(); ++k) {
    compare_buffer(finding, k, before[k], guarded[k].values(device), exact[k]);
  }
  return finding;
}

void add(Device& device, std::vector<KernelCheck>& rows, const Case& test) {
  const VectorArguments& a = test.arguments;
  KernelCheck row;
  row.kernel = test.kernel;
  row.parameters = fmt::format("columns={} blocks_per_group={} option={} slot={} seed={}", a.columns,
                               a.blocks_per_group, a.option, a.slot, test.seed);
  row.size = a.n;
  row.bound = rounding_bound(reference::vector_roundings(a));
  add_case(rows, std::move(row), [&] { return run(device, test); });
}

}  // namespace

void check_vectors(Device& device, std::vector<KernelCheck>& rows, const Selection& selection) {
  constexpr std::array kernels{"dot",     "reduce",           "axpby",         "bounce",       "cg_product",
                               "cg_step", "bicgstab_product", "bicgstab_half", "bicgstab_step"};
  for (const std::uint32_t n : {1U, 2U, 31U, 32U, 33U, 63U, 64U, 65U, 255U, 256U, 257U, 1024U, 1025U, 1312U, 5791U}) {
    if (n > selection.max_size) continue;
    for (const std::string_view kernel : kernels) {
      if (!selection.kernel.empty() && kernel != selection.kernel) continue;
      for (const std::uint32_t blocks_per_group : {1U, 3U, 100U}) {
        Case test{kernel, {}, n * 2654435761U + blocks_per_group};
        test.arguments.n = n;
        test.arguments.vector_stride = (n + 15) / 16 * 16 + 16;
        test.arguments.columns = columns;
        test.arguments.blocks = blocks_of(n);
        test.arguments.blocks_per_group = blocks_per_group;
        if (kernel == "bounce") test.arguments.option = blocks_per_group == 3 ? 1 : 0;
        if (kernel == "dot" || kernel == "reduce") test.arguments.option = blocks_per_group % sum_sets;
        test.arguments.slot = kernel == "reduce" ? blocks_per_group % scalar_slots : 0;
        add(device, rows, test);
      }
    }
  }
}

}  // namespace interflect::check
