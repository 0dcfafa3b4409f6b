#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "device/broken_device.h"
#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/openmp/simd.h"
#include "interflect/device/registry.h"

namespace interflect {
namespace {

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": error " + std::to_string(row.error) +
         " bound " + std::to_string(row.bound) + " " + row.reason;
}

/// Every instruction set of this machine, one test each, so that ctest names the one that fails.
class EverySimdTarget : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override { openmp::use_simd_target(GetParam()); }
  void TearDown() override { openmp::use_simd_target(""); }
};

TEST_P(EverySimdTarget, KernelsStayWithinTheirBounds) {
  const auto device = open_device("openmp");
  EXPECT_THAT(device->info().driver, testing::HasSubstr(GetParam()));
  const std::vector<KernelCheck> rows = check_device(*device);
  EXPECT_GT(rows.size(), 200U);
  for (const KernelCheck& row : rows) {
    EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
    EXPECT_EQ(row.device, "openmp");
  }
}

/// y = F x on the device, in panels of so many rows.
std::vector<float> product(Device& device, std::uint32_t n, std::uint32_t columns, std::uint32_t panel_rows) {
  const std::uint32_t stride = (n + 15) / 16 * 16;
  std::vector<float> f(std::size_t{n} * stride);
  for (std::size_t i = 0; i < f.size(); ++i) f[i] = std::sin(static_cast<float>(i));
  std::vector<float> x(std::size_t{columns} * stride);
  for (std::size_t i = 0; i < x.size(); ++i) x[i] = std::cos(static_cast<float>(i));
  std::vector<float> y(x.size());
  const auto x_buffer = device.allocate(x.size() * sizeof(float));
  const auto y_buffer = device.allocate(y.size() * sizeof(float));
  device.queue().upload(*x_buffer, 0, std::as_bytes(std::span(x)));
  const auto kernel = device.kernel("matvec", {{"COLUMNS", static_cast<int>(columns)}});
  for (std::uint32_t first = 0; first < n; first += panel_rows) {
    const MatvecArguments arguments{n, first, std::min(panel_rows, n - first), stride, stride};
    const auto panel =
        std::as_bytes(std::span(f))
            .subspan(std::size_t{first} * stride * sizeof(float), std::size_t{arguments.rows} * stride * sizeof(float));
    const auto f_buffer = device.allocate(panel.size());
    device.queue().upload(*f_buffer, 0, panel);
    Buffer* const buffers[] = {f_buffer.get(), x_buffer.get(), y_buffer.get()};
    device.queue().launch(*kernel, (arguments.rows + 15) / 16, buffers, std::as_bytes(std::span(&arguments, 1)),
                          "Test");
  }
  device.queue().download(*y_buffer, 0, std::as_writable_bytes(std::span(y)));
  return y;
}

TEST_P(EverySimdTarget, SumsDoNotDependOnThreadsOrPanels) {
  const auto device = open_device("openmp");
  constexpr std::uint32_t n = 1313;
  omp_set_num_threads(1);
  const std::vector<float> one = product(*device, n, 4, n);
  for (const int threads : {2, 3}) {
    omp_set_num_threads(threads);
    EXPECT_EQ(product(*device, n, 4, n), one) << threads << " threads";
  }
  for (const std::uint32_t panel_rows : {1U, 7U, 500U}) {
    EXPECT_EQ(product(*device, n, 4, panel_rows), one) << panel_rows << " rows in a panel";
  }
  const std::vector<float> one_column = product(*device, n, 1, n);
  EXPECT_TRUE(std::equal(one_column.begin(), one_column.end(), one.begin())) << "column 0 alone";
  omp_set_num_threads(omp_get_num_procs());
}

INSTANTIATE_TEST_SUITE_P(Simd, EverySimdTarget, testing::ValuesIn(openmp::simd_targets()),
                         [](const auto& target) { return target.param; });

TEST(SimdTarget, EachOneReallyRuns) {
  const auto device = open_device("openmp");
  std::vector<std::vector<float>> results;
  for (const std::string& target : openmp::simd_targets()) {
    openmp::use_simd_target(target);
    EXPECT_EQ(openmp::simd_target(), target);
    results.push_back(product(*device, 1313, 1, 1313));
  }
  openmp::use_simd_target("");
  EXPECT_EQ(openmp::simd_target(), openmp::simd_targets().front());
  // Other lanes, other roundings: the last one has one lane, and no other target gives its bits.
  for (std::size_t i = 0; i + 1 < results.size(); ++i) EXPECT_NE(results[i], results.back());
}

// The twins: what a check is worth shows when the kernel is broken.

/// A plain serial matvec with one thing wrong with it.
struct Defect {
  std::string name;
  std::function<void(MatvecArguments&, std::uint32_t& row_stride)> falsify;
  std::function<bool(const KernelCheck&)> must_show;  ///< the cases in which it cannot hide
  std::uint32_t columns = 24;                         ///< those before this one are computed
  std::uint32_t shorter = 24;                         ///< those from here on get the first 1,024 products alone
};

std::uint32_t panel_rows(const KernelCheck& row) {
  const std::size_t at = row.parameters.find("panel_rows=") + 11;
  return static_cast<std::uint32_t>(std::stoul(row.parameters.substr(at)));
}

void multiply(test::Launched& launch, const Defect& defect) {
  auto a = launch.as<MatvecArguments>();
  std::uint32_t row_stride = a.row_stride;
  defect.falsify(a, row_stride);
  const auto columns = static_cast<std::uint32_t>(launch.macros.at("COLUMNS"));
  for (std::uint32_t c = 0; c < std::min(columns, defect.columns); ++c) {
    for (std::uint32_t r = 0; r < a.rows; ++r) {
      double sum = 0;
      for (std::uint32_t j = 0; j < (c < defect.shorter ? a.n : std::min(a.n, 1024U)); ++j) {
        sum += static_cast<double>(launch.buffers[0].at(std::size_t{r} * row_stride + j)) *
               static_cast<double>(launch.buffers[1].at(std::size_t{c} * a.vector_stride + j));
      }
      launch.buffers[2].at(std::size_t{c} * a.vector_stride + a.first + r) = static_cast<float>(sum);
    }
  }
}

std::vector<Defect> defects() {
  using A = MatvecArguments;
  const auto always = [](const KernelCheck&) { return true; };
  const auto odd = [](const KernelCheck& row) { return row.size % 16 != 0; };
  const auto of_24 = [](const KernelCheck& row) { return row.parameters.starts_with("COLUMNS=24 "); };
  return {
      {"TailOfAVectorDropped", [](A& a, std::uint32_t&) { a.n = a.n / 16 * 16; }, odd},
      {"LastProductDropped", [](A& a, std::uint32_t&) { --a.n; }, always},
      {"LastColumnBlockDropped", [](A& a, std::uint32_t&) { a.n = a.n > 1024 ? 1024 : a.n; },
       [](const KernelCheck& row) { return row.size > 1024; }},
      {"RowsPackedWithoutPadding", [](A& a, std::uint32_t& row_stride) { row_stride = a.n; },
       [=](const KernelCheck& row) { return odd(row) && panel_rows(row) > 1; }},
      {"PaddingRead", [](A& a, std::uint32_t&) { a.n = a.row_stride; }, odd},
      {"LastRowDropped", [](A& a, std::uint32_t&) { --a.rows; }, always},
      {"OneRowTooMany",
       [](A& a, std::uint32_t& row_stride) {
         ++a.rows;
         row_stride = 0;
       },
       always},
      {"FirstIgnored", [](A& a, std::uint32_t&) { a.first = 0; },
       [=](const KernelCheck& row) {  // several panels; the longest rows are 19, or 37
         return panel_rows(row) < (of_24(row) && row.size > 257 ? 37 : row.size > 1313 ? 19 : row.size);
       }},
      {"ColumnsTooNear", [](A& a, std::uint32_t&) { a.vector_stride -= 16; },
       [](const KernelCheck& row) { return !row.parameters.starts_with("COLUMNS=1 "); }},
      {"LastColumnForgotten", [](A&, std::uint32_t&) {}, of_24, 23},
      {"ChunksAfterTheFirstEndAtABlock", [](A&, std::uint32_t&) {},
       [=](const KernelCheck& row) { return of_24(row) && row.size > 1024; }, 24, 12},
  };
}

class BrokenMatvec : public testing::TestWithParam<Defect> {};

TEST_P(BrokenMatvec, FailsTheCheck) {
  const Defect& defect = GetParam();
  test::ReplacedKernelDevice device(open_device("openmp"), "matvec",
                                    [&](test::Launched& launch) { multiply(launch, defect); });
  std::size_t shown = 0;
  for (const KernelCheck& row : check_device(device)) {
    if (row.kernel != "matvec" || !defect.must_show(row)) continue;
    ++shown;
    EXPECT_EQ(row.status, CheckStatus::fail) << describe(row);
  }
  EXPECT_GT(shown, 0U);
}

INSTANTIATE_TEST_SUITE_P(Twin, BrokenMatvec, testing::ValuesIn(defects()),
                         [](const auto& defect) { return defect.param.name; });

TEST(BrokenMatvecTwin, PassesWithoutADefect) {
  const Defect none{"None", [](MatvecArguments&, std::uint32_t&) {}, {}};
  test::ReplacedKernelDevice device(open_device("openmp"), "matvec",
                                    [&](test::Launched& launch) { multiply(launch, none); });
  for (const KernelCheck& row : check_device(device)) EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
}

TEST(BrokenMatvecTwin, ALostProductIsFarAboveTheBound) {
  const Defect lost{"Lost", [](MatvecArguments& a, std::uint32_t&) { --a.n; }, {}};
  test::ReplacedKernelDevice device(open_device("openmp"), "matvec",
                                    [&](test::Launched& launch) { multiply(launch, lost); });
  for (const KernelCheck& row : check_device(device)) {
    if (row.kernel == "matvec") {
      EXPECT_GT(row.error, 4 * row.bound) << describe(row);
    }
  }
}

TEST(CheckDevice, ALimitOfTheDeviceIsUnsupportedAndAnErrorIsAFailure) {
  test::ReplacedKernelDevice device(open_device("openmp"), "copy",
                                    [](test::Launched&) { throw device_error("openmp", "launch copy", "lost"); });
  device.limit_buffers(100000);
  std::size_t unsupported = 0;
  for (const KernelCheck& row : check_device(device)) {
    const bool large = row.kernel == "matvec" && row.size > 1000;
    if (large && row.status == CheckStatus::unsupported) ++unsupported;
    if (row.kernel == "copy") {
      EXPECT_EQ(row.status, CheckStatus::fail);
      EXPECT_EQ(row.reason, "openmp: launch copy: lost");
    } else if (row.size < 150) {
      EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
    } else {
      EXPECT_NE(row.status, CheckStatus::fail) << describe(row);
    }
    if (row.status == CheckStatus::unsupported) {
      EXPECT_THAT(row.reason, testing::HasSubstr("larger buffer"));
    }
  }
  EXPECT_GT(unsupported, 0U);
  EXPECT_EQ(name(CheckStatus::pass), "pass");
  EXPECT_EQ(name(CheckStatus::fail), "fail");
  EXPECT_EQ(name(CheckStatus::unsupported), "unsupported");
}

}  // namespace
}  // namespace interflect
