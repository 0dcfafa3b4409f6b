#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "device/cuda_on_cpu_device.h"
#include "interflect/schedule/check_assembly.h"
#include "sanitized.h"

// The CUDA kernels of the assembly on the processor: every case of the check, in other orders of the threads, and the
// twins.

namespace interflect {
namespace {

using cuda_on_cpu::Order;

std::string describe(const KernelCheck& row) {
  return row.parameters + ": error " + std::to_string(row.error) + " bound " + std::to_string(row.bound) + " " +
         row.reason;
}

std::vector<KernelCheck> checked(const std::string& variant, std::string_view only = {}) {
  test::CudaOnCpu device(variant);
  std::vector<KernelCheck> rows;
  check::check_assembly(device, rows, only);
  return rows;
}

TEST(CudaAssembly, StaysWithinItsBoundsInEveryOrder) {
  for (const Order order : {Order::forwards, Order::backwards, Order::shuffled}) {
    if (test::sanitized && order != Order::shuffled) continue;
    cuda_on_cpu::use_order(order);
    const std::vector<KernelCheck> rows = checked("");
    EXPECT_EQ(rows.size(), 9U);
    for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
  }
  cuda_on_cpu::use_order(Order::forwards);
}

struct Twin {
  const char* variant;
  const char* seen_by;
};
void PrintTo(const Twin& twin, std::ostream* out) {
  *out << twin.variant;
}
class CudaAssemblyTwins : public testing::TestWithParam<Twin> {};
INSTANTIATE_TEST_SUITE_P(OnCpu, CudaAssemblyTwins,
                         testing::Values(Twin{"EdgeDropped", "near"}, Twin{"MirrorForgotten", "far"},
                                         Twin{"HitsIgnored", "hidden"}),
                         testing::PrintToStringParamName());

TEST_P(CudaAssemblyTwins, AreSeen) {
  const std::vector<KernelCheck> rows = checked(GetParam().variant, GetParam().seen_by);
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows[0].status, CheckStatus::fail) << describe(rows[0]);
}

}  // namespace
}  // namespace interflect
