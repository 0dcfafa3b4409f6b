#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <set>
#include <string>

#include "device/cuda_on_cpu_device.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "sanitized.h"

// The CUDA kernels without a GPU: their logic on the processor. See also fake_cuda/, where the backend runs on a fake
// driver, and cuda_nvrtc_test.cpp, where they are compiled for real GPUs.

namespace interflect {
namespace {

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
}

using cuda_on_cpu::Order;

// Under AddressSanitizer a fiber's switch takes two system calls: there only small sizes are run, in one order of the
// threads, and one twin of each kind; the output says so. Every other build runs all.
using test::sanitized;

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

/// Of the cases up to n = 33 each kernel's, and matvec with two numbers of columns.
std::vector<KernelCheck> few_checks(Device& device) {
  std::cout << "under the sanitizers: n up to 33, 3 and 7 columns\n";
  std::vector<KernelCheck> rows;
  check::check_stream(device, rows, {.max_size = 33});
  for (const std::uint32_t columns : {3U, 7U}) check::check_matvec(device, rows, {.max_size = 33, .columns = columns});
  check::check_resident(device, rows, {.max_size = 33, .columns = 3});
  check::check_vectors(device, rows, {.max_size = 33});
  return rows;
}

TEST_P(CudaKernels, StayWithinTheirBounds) {
  if (sanitized) {
    if (GetParam().second != Order::shuffled) GTEST_SKIP() << "under the sanitizers in one order only, shuffled";
    test::CudaOnCpu device;
    const std::vector<KernelCheck> rows = few_checks(device);
    EXPECT_GT(rows.size(), 150U);
    for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
    return;
  }
  const bool all = GetParam().second == Order::forwards;
  test::CudaOnCpu device("", all ? test::CudaOnCpu::large : test::CudaOnCpu::small);
  const std::vector<KernelCheck> rows = check_device(device);
  EXPECT_GE(rows.size(), 1165U) << "cases are missing";
  for (const KernelCheck& row : rows) {
    // Most of these do not fit into the small device; cuda_packed_test.cpp runs the 16-bit formats in every order.
    const bool may_be_large =
        row.kernel.starts_with("matvec") || row.kernel == "tiles16" || row.kernel.starts_with("sym16");
    if (!all && may_be_large && row.size > 500) {
      EXPECT_NE(row.status, CheckStatus::fail) << describe(row);
    } else {
      EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
    }
  }
}

/// The bits that a device computes for a product and for sums over more blocks than a warp has lanes.
std::vector<float> results(Device& device, std::uint32_t rows_in_group) {
  constexpr std::uint32_t n = 1313, stride = 1328, columns = 3, rows = sanitized ? 40 : n;
  const auto buffer = [&](const std::vector<float>& values) {
    auto made = device.allocate(values.size() * sizeof(float));
    device.queue().upload(*made, 0, std::as_bytes(std::span(values)));
    return made;
  };
  const auto f = buffer(check::Random(1).numbers(std::size_t{n} * stride));
  const auto x = buffer(check::Random(2).numbers(std::size_t{columns} * stride));
  const auto y = buffer(std::vector<float>(std::size_t{columns} * stride));
  const auto matvec = device.kernel("matvec", {{"COLUMNS", 3}, {"ROWS", static_cast<int>(rows_in_group)}});
  const MatvecArguments product{.n = n, .first = 0, .rows = rows, .row_stride = stride, .vector_stride = stride};
  Buffer* const of_product[] = {f.get(), x.get(), y.get()};
  device.queue().launch(*matvec, (rows + rows_in_group - 1) / rows_in_group, of_product,
                        std::as_bytes(std::span(&product, 1)), "Test");
  std::vector<float> all(std::size_t{columns} * stride);
  device.queue().download(*y, 0, std::as_writable_bytes(std::span(all)));
  return all;
}

std::vector<float> sums(Device& device, std::uint32_t n, std::uint32_t blocks_per_group) {
  const std::uint32_t stride = (n + 15) / 16 * 16;
  VectorArguments arguments{.n = n,
                            .vector_stride = stride,
                            .columns = 2,
                            .blocks = (n + 1023) / 1024,
                            .blocks_per_group = blocks_per_group,
                            .option = 1,
                            .slot = 3};
  std::vector<float> values = check::Random(3).numbers(std::size_t{2} * stride);
  const auto x = device.allocate(values.size() * sizeof(float));
  const auto y = device.allocate(values.size() * sizeof(float));
  device.queue().upload(*x, 0, std::as_bytes(std::span(values)));
  device.queue().upload(*y, 0, std::as_bytes(std::span(values)));
  std::vector<float> found(sums_size(2, arguments.blocks));
  const auto of_sums = device.allocate(found.size() * sizeof(float));
  const auto dot = device.kernel("dot", {});
  const auto reduce = device.kernel("reduce", {});
  const std::uint32_t groups = (2 * arguments.blocks + blocks_per_group - 1) / blocks_per_group;
  Buffer* const of_dot[] = {x.get(), y.get(), of_sums.get()};
  Buffer* const of_reduce[] = {of_sums.get()};
  device.queue().launch(*dot, groups, of_dot, std::as_bytes(std::span(&arguments, 1)), "Test");
  device.queue().launch(*reduce, groups, of_reduce, std::as_bytes(std::span(&arguments, 1)), "Test");
  device.queue().download(*of_sums, 0, std::as_writable_bytes(std::span(found)));
  return found;
}

TEST(CudaKernelsOnCpu, GiveTheSameBitsWhateverTheOrderOfTheThreadsAndTheGroups) {
  test::CudaOnCpu device;
  cuda_on_cpu::use_order(Order::forwards);
  constexpr std::uint32_t n = sanitized ? 5791 : 40001;
  if (sanitized) std::cout << "under the sanitizers: small sizes, two orders\n";
  const std::vector<float> product = results(device, 8);
  const std::vector<float> dots = sums(device, n, 1);
  for (const Order order : {Order::forwards, Order::backwards, Order::shuffled}) {
    if (sanitized && order != Order::shuffled) continue;
    cuda_on_cpu::use_order(order);
    // A row's sum does not depend on the strip that it is in.
    for (const std::uint32_t rows : {8U, 16U, 20U}) EXPECT_EQ(results(device, rows), product) << rows;
    for (const std::uint32_t blocks : {1U, 7U, 100U}) EXPECT_EQ(sums(device, n, blocks), dots) << blocks;
  }
  cuda_on_cpu::use_order(Order::forwards);
}

TEST(CudaKernelsOnCpu, ATotalAddsMoreBlocksThanAWarpHasLanes) {
  test::CudaOnCpu device;
  for (const std::uint32_t n : {32U * 1024, 32U * 1024 + 1, 64U * 1024 - 1, 70001U}) {
    if (sanitized && n != 32U * 1024 + 1) continue;
    const std::uint32_t stride = (n + 15) / 16 * 16;
    const std::vector<float> values = check::Random(3).numbers(std::size_t{2} * stride);
    const std::vector<float> found = sums(device, n, 1);
    for (std::uint32_t c = 0; c < 2; ++c) {
      double exact = 0;
      for (std::uint32_t i = 0; i < n; ++i) exact += std::pow(static_cast<double>(values[c * stride + i]), 2);
      EXPECT_NEAR(found[3 * 2 + c], exact, exact * check::rounding_bound(80 + (n + 1023) / 1024)) << n;
    }
  }
}

/// More columns than fit in registers: F is cut into segments of 4,096, and x into chunks.
TEST(CudaKernelsOnCpu, SegmentsOfManyColumnsJoin) {
  constexpr std::uint32_t rows = 9, columns = 7;
  test::CudaOnCpu device;
  for (const std::uint32_t n : {4095U, 4096U, 4097U, 8203U}) {
    const std::uint32_t stride = (n + 15) / 16 * 16;
    const std::vector<float> f = check::Random(n).numbers(std::size_t{rows} * stride);
    const std::vector<float> x = check::Random(n + 1).numbers(std::size_t{columns} * stride);
    const auto f_buffer = device.allocate(f.size() * sizeof(float));
    const auto x_buffer = device.allocate(x.size() * sizeof(float));
    const auto y_buffer = device.allocate(x.size() * sizeof(float));
    device.queue().upload(*f_buffer, 0, std::as_bytes(std::span(f)));
    device.queue().upload(*x_buffer, 0, std::as_bytes(std::span(x)));
    const auto kernel = device.kernel("matvec", {{"COLUMNS", columns}, {"ROWS", 8}});
    const MatvecArguments product{.n = n, .first = 3, .rows = rows, .row_stride = stride, .vector_stride = stride};
    Buffer* const buffers[] = {f_buffer.get(), x_buffer.get(), y_buffer.get()};
    device.queue().launch(*kernel, 2, buffers, std::as_bytes(std::span(&product, 1)), "Test");
    std::vector<float> y(x.size());
    device.queue().download(*y_buffer, 0, std::as_writable_bytes(std::span(y)));
    for (std::uint32_t c = 0; c < columns; ++c) {
      for (std::uint32_t r = 0; r < rows; ++r) {
        double exact = 0, magnitude = 0;
        for (std::uint32_t j = 0; j < n; ++j) {
          const double term = static_cast<double>(f[r * stride + j]) * static_cast<double>(x[c * stride + j]);
          exact += term;
          magnitude += std::abs(term);
        }
        EXPECT_NEAR(y[c * stride + 3 + r], exact, magnitude * matvec_bound(n)) << n << " row " << r << " column " << c;
      }
    }
  }
}

// The twins. A defect is a text that is replaced in a kernel; fake_cuda/CMakeLists.txt lists them.

struct Defect {
  std::string name;
  std::set<std::string> kernels;  ///< in which it must show, in one order of the threads or another
};
void PrintTo(const Defect& defect, std::ostream* out) {
  *out << defect.name << " in " << testing::PrintToString(defect.kernels);
}

/// The kernels that fail on a device that has the defect; all others pass. Products are built with the defect for three
/// columns only.
std::set<std::string> failing(const Defect& defect) {
  const bool products = defect.kernels.count("matvec") != 0;
  const bool streams = defect.kernels.count("read") + defect.kernels.count("copy") != 0;
  const bool resident = defect.kernels.count("matvec_exact") + defect.kernels.count("close_rows") != 0;
  std::set<std::string> found;
  for (const Order order : {Order::forwards, Order::backwards, Order::shuffled}) {
    if (sanitized && order != Order::forwards) continue;
    if (resident && !found.empty()) break;  // a single kernel is checked
    cuda_on_cpu::use_order(order);
    test::CudaOnCpu device(defect.name, test::CudaOnCpu::small);
    std::vector<KernelCheck> rows;
    if (products) {
      check::check_matvec(device, rows, {.max_size = sanitized ? 33U : 255U, .columns = 3});
    } else if (resident) {
      check::check_resident(device, rows,
                            {.max_size = sanitized                                 ? 33U
                                         : defect.kernels.count("close_rows") != 0 ? 1025U
                                                                                   : 129U,
                             .columns = 3,
                             .kernel = *defect.kernels.begin()});
    } else if (streams) {
      check::check_stream(device, rows, {.max_size = sanitized ? 33U : every_size});
    } else {
      check::check_vectors(device, rows, {.max_size = sanitized ? 33U : 1025U});
    }
    for (const KernelCheck& row : rows) {
      if (row.status == CheckStatus::fail) found.insert(row.kernel);
    }
  }
  cuda_on_cpu::use_order(Order::forwards);
  return found;
}

const std::set<std::string> with_vectors = {
    "dot", "bounce", "cg_product", "cg_step", "bicgstab_product", "bicgstab_half", "bicgstab_step"};
const std::set<std::string> with_partials = {"dot",     "bounce",           "cg_product",
                                             "cg_step", "bicgstab_product", "bicgstab_step"};
// reduce takes its total in the thread that added it.
const std::set<std::string> with_totals = {"cg_product", "cg_step", "bicgstab_half", "bicgstab_step"};
// The two steps add totals and write partial sums in turn: there either barrier stands in for the other.
const std::set<std::string> one_barrier = {"dot", "bounce", "cg_product", "bicgstab_product", "bicgstab_half"};

class BrokenCudaKernel : public testing::TestWithParam<Defect> {};

TEST_P(BrokenCudaKernel, FailsTheCheck) {
  const std::set<std::string> few = {"TailDropped", "WarpsNotAwaited"};
  if (sanitized && few.count(GetParam().name) == 0) GTEST_SKIP() << "under the sanitizers only one twin of each kind";
  EXPECT_EQ(failing(GetParam()), GetParam().kernels);
}

INSTANTIATE_TEST_SUITE_P(Twin, BrokenCudaKernel,
                         testing::Values(Defect{"TailDropped", {"matvec"}}, Defect{"PaddingRead", {"matvec"}},
                                         Defect{"RowsPacked", {"matvec"}}, Defect{"ColumnsTooNear", {"matvec"}},
                                         Defect{"RowsBehindThePanel", {"matvec"}},
                                         Defect{"WarpsNotAwaited", {"matvec"}}, Defect{"LanesNotJoined", {"matvec"}},
                                         Defect{"RestDropped", {"copy"}}, Defect{"RestNotAdded", {"read"}},
                                         Defect{"WarpsNotAwaited", {"read"}}, Defect{"TailDropped", with_vectors},
                                         Defect{"ColumnsTooNear", with_vectors}, Defect{"HalfAWarp", with_partials},
                                         Defect{"WarpsNotAwaited", with_partials},
                                         Defect{"TotalsNotAwaited", with_totals},
                                         Defect{"ItemsNotAwaited", one_barrier}),
                         [](const auto& info) { return info.param.name + "_" + std::to_string(info.index); });
INSTANTIATE_TEST_SUITE_P(
    TwinOfResident, BrokenCudaKernel,
    testing::Values(Defect{"TailDropped", {"matvec_exact"}}, Defect{"PaddingRead", {"matvec_exact"}},
                    Defect{"RoundingsForgotten", {"matvec_exact"}}, Defect{"SumsRounded", {"matvec_exact"}},
                    Defect{"ProductFolded", {"matvec_exact"}}, Defect{"LanesJoinedAsFloats", {"matvec_exact"}},
                    Defect{"WarpsNotAwaited", {"matvec_exact"}}, Defect{"RowsBehindThePanel", {"matvec_exact"}},
                    Defect{"TailDropped", {"close_rows"}}, Defect{"PaddingRead", {"close_rows"}},
                    Defect{"ZerosCounted", {"close_rows"}}, Defect{"WarpForgotten", {"close_rows"}},
                    Defect{"WarpsNotAwaited", {"close_rows"}}, Defect{"RowsBehindThePanel", {"close_rows"}}),
    [](const auto& info) { return info.param.name + "_" + *info.param.kernels.begin(); });

TEST(BrokenCudaKernelTwin, ABarrierBetweenStripsIsMissed) {
  test::CudaOnCpu device("StripsNotAwaited"), sound;
  bool seen = false;
  for (const Order order : {Order::forwards, Order::backwards, Order::shuffled}) {
    cuda_on_cpu::use_order(order);
    if (!seen) seen = results(device, 20) != results(sound, 20);
  }
  cuda_on_cpu::use_order(Order::forwards);
  EXPECT_TRUE(seen);
}

}  // namespace
}  // namespace interflect
