#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "device/cuda_on_cpu_device.h"
#include "interflect/device/check.h"

// The CUDA kernels without a GPU: their logic on the processor. See also fake_cuda/, where the backend runs on a fake
// driver, and cuda_nvrtc_test.cpp, where they are compiled for real GPUs.

namespace interflect {
namespace {

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
}

using cuda_on_cpu::Order;

class CudaKernels : public testing::TestWithParam<std::pair<std::string, Order>> {
 protected:
  void SetUp() override { cuda_on_cpu::use_order(GetParam().second); }
  void TearDown() override { cuda_on_cpu::use_order(Order::forwards); }
};
INSTANTIATE_TEST_SUITE_P(OnCpu, CudaKernels,
                         testing::Values(std::pair("Forwards", Order::forwards),
                                         std::pair("Backwards", Order::backwards),
                                         std::pair("Shuffled", Order::shuffled)),
                         [](const auto& info) { return info.param.first; });

TEST_P(CudaKernels, StayWithinTheirBounds) {
  test::CudaOnCpu device;
  const std::vector<KernelCheck> rows = check_device(device);
  EXPECT_EQ(rows.size(), 715U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
}

}  // namespace
}  // namespace interflect
