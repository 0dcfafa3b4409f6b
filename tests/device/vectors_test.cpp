#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>

#include "device/broken_device.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/registry.h"
#include "interflect/device/vector_reference.h"

namespace interflect {
namespace {

constexpr std::array kernels{"dot",     "reduce",           "axpby",         "bounce",       "cg_product",
                             "cg_step", "bicgstab_product", "bicgstab_half", "bicgstab_step"};

TEST(VectorKernels, StayWithinTheirBounds) {
  const auto device = open_device("openmp");
  std::vector<KernelCheck> rows;
  check::check_vectors(*device, rows);
  for (const char* kernel : kernels) {
    EXPECT_EQ(std::count_if(rows.begin(), rows.end(), [&](const KernelCheck& row) { return row.kernel == kernel; }),
              45);
  }
  for (const KernelCheck& row : rows) {
    EXPECT_EQ(row.status, CheckStatus::pass) << row.kernel << " n=" << row.size << " " << row.parameters << ": error "
                                             << row.error << " bound " << row.bound << " " << row.reason;
  }
}

/// What a kernel does in fp32, by the reference: with changed arguments it is a broken kernel.
void compute(std::string_view kernel, const VectorArguments& arguments, std::vector<std::vector<float>>& buffers) {
  std::vector<reference::Numbers> numbers;
  for (const auto& buffer : buffers) {
    reference::Numbers& column = numbers.emplace_back();
    for (const float value : buffer) column.emplace_back(static_cast<double>(value));
  }
  reference::vector_kernel(kernel, arguments, numbers);
  for (std::size_t k = 0; k < buffers.size(); ++k) {
    for (std::size_t i = 0; i < buffers[k].size(); ++i) {
      if (numbers[k][i].written) buffers[k][i] = static_cast<float>(numbers[k][i].value);
    }
  }
}

using Defect = std::function<void(test::Launched&, VectorArguments&)>;

/// The rows of `kernel` that fail on a device where the kernel has the defect.
std::size_t failures(const char* kernel, const Defect& defect) {
  const auto replacement = [&](test::Launched& launched) {
    auto arguments = launched.as<VectorArguments>();
    defect(launched, arguments);
    compute(kernel, arguments, launched.buffers);
  };
  test::ReplacedKernelDevice device(open_device("openmp"), kernel, replacement);
  std::vector<KernelCheck> rows;
  check::check_vectors(device, rows);
  std::size_t count = 0;
  for (const KernelCheck& row : rows) {
    EXPECT_TRUE(row.kernel == kernel || row.status == CheckStatus::pass) << row.kernel;
    count += row.kernel == kernel && row.status == CheckStatus::fail ? 1 : 0;
  }
  return count;
}

class BrokenVectorKernel : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Check, BrokenVectorKernel, testing::ValuesIn(kernels),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(BrokenVectorKernel, ASoundReplacementPasses) {
  EXPECT_EQ(failures(GetParam(), [](test::Launched&, VectorArguments&) {}), 0U);
}

TEST_P(BrokenVectorKernel, ADroppedTailFails) {
  if (GetParam() == std::string("reduce")) {  // its tail is the last block
    EXPECT_GT(failures(GetParam(),
                       [](test::Launched& launched, VectorArguments& a) {
                         // as if the last block's sums were not there
                         for (std::uint32_t k = 0; k < sum_sets * a.columns; ++k) {
                           launched.buffers.back()[scalar_slots * a.columns + (k + 1) * a.blocks - 1] = 0;
                         }
                       }),
              40U);
    return;
  }
  EXPECT_EQ(failures(GetParam(), [](test::Launched&, VectorArguments& a) { --a.n; }), 45U);
}

TEST_P(BrokenVectorKernel, AWrongStrideFails) {
  if (GetParam() == std::string("reduce")) return;  // has no vectors
  EXPECT_EQ(failures(GetParam(), [](test::Launched&, VectorArguments& a) { a.vector_stride -= 16; }), 45U);
}

TEST_P(BrokenVectorKernel, AMissingColumnFails) {
  EXPECT_GE(failures(GetParam(), [](test::Launched&, VectorArguments& a) { --a.columns; }), 40U);
}

/// As if a barrier were missing: one work item reads an element before it is there.
TEST_P(BrokenVectorKernel, AnElementReadTooEarlyFails) {
  if (GetParam() == std::string("reduce")) return;
  const char* kernel = GetParam();
  const auto replacement = [&](test::Launched& launched) {
    const auto arguments = launched.as<VectorArguments>();
    for (std::size_t k = 0; k + 1 < launched.buffers.size(); ++k) launched.buffers[k][arguments.n / 2] = 0;
    compute(kernel, arguments, launched.buffers);
  };
  test::ReplacedKernelDevice device(open_device("openmp"), kernel, replacement);
  std::vector<KernelCheck> rows;
  check::check_vectors(device, rows);
  for (const KernelCheck& row : rows) {
    EXPECT_EQ(row.status, row.kernel == kernel ? CheckStatus::fail : CheckStatus::pass) << row.kernel << row.size;
  }
}

}  // namespace
}  // namespace interflect
