#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

#include "device/broken_device.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/registry.h"

// matvec_exact and close_rows: within their bounds, and twins that the check must see.

namespace interflect {
namespace {

std::string describe(const KernelCheck& row) {
  return row.kernel + " n=" + std::to_string(row.size) + " " + row.parameters + ": " + row.reason;
}

std::vector<KernelCheck> checked(Device& device, const char* kernel, std::uint64_t max_size = 300) {
  std::vector<KernelCheck> rows;
  check::check_resident(device, rows, {.max_size = max_size, .kernel = kernel});
  EXPECT_GT(rows.size(), 20U);
  return rows;
}

TEST(ResidentKernels, StayWithinTheirBounds) {
  const auto device = open_device("openmp");
  for (const char* kernel : {"matvec_exact", "close_rows"}) {
    for (const KernelCheck& row : checked(*device, kernel, every_size)) {
      EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
    }
  }
}

TEST(ResidentKernels, TheBoundOfTheExactProductIsFarBelowAFloats) {
  EXPECT_LT(matvec_exact_bound(1), 1e-12);
  EXPECT_LT(matvec_exact_bound(17128), 4e-11);
  EXPECT_LT(matvec_exact_bound(1U << 20), 2e-10);
  EXPECT_LT(100 * matvec_exact_bound(17128), matvec_bound(1));
}

/// One thing wrong with a serial kernel in compensated single precision, or nothing.
struct ExactDefect {
  std::string name;
  bool product = true, sum = true, low = true;  ///< what of the roundings is kept
  bool folded = false;                          ///< the product is folded into the sum, as a compiler may
  std::function<void(MatvecArguments&)> falsify = [](MatvecArguments&) {};
  bool tail = false;      ///< shows only where n is no multiple of 16
  bool of_panel = false;  ///< shows only in panels that do not begin at 0
};

void multiply(test::Launched& launch, const ExactDefect& defect) {
  auto a = launch.as<MatvecArguments>();
  defect.falsify(a);
  const auto columns = static_cast<std::size_t>(launch.macros.at("COLUMNS"));
  for (std::size_t k = 0; k < columns * a.rows; ++k) {
    const std::size_t c = k / a.rows, r = k % a.rows;
    float hi = 0, lo = 0;
    for (std::size_t j = 0; j < a.n; ++j) {
      const float f = launch.buffers[0].at(r * a.row_stride + j), x = launch.buffers[1].at(c * a.vector_stride + j);
      volatile float p = f * x;
      const float e = std::fma(f, x, -p);
      volatile float s = defect.folded ? std::fma(f, x, hi) : hi + p;
      volatile float s_p = s - hi;
      volatile float s_hi = s - s_p;
      const float t = (hi - s_hi) + (p - s_p);
      lo += (defect.sum ? t : 0.0F) + (defect.product ? e : 0.0F);
      hi = s;
    }
    const std::size_t at = c * a.vector_stride + a.first + r;
    launch.buffers[2].at(at) = hi;
    launch.buffers[2].at(columns * a.vector_stride + at) = defect.low ? lo : 0.0F;
  }
}

class BrokenMatvecExact : public testing::TestWithParam<ExactDefect> {};
INSTANTIATE_TEST_SUITE_P(
    Twin, BrokenMatvecExact,
    testing::Values(
        ExactDefect{.name = "ProductsRounded", .product = false}, ExactDefect{.name = "SumsRounded", .sum = false},
        ExactDefect{.name = "LowPartLost", .low = false}, ExactDefect{.name = "ProductFolded", .folded = true},
        ExactDefect{.name = "LastProductDropped", .falsify = [](MatvecArguments& a) { --a.n; }},
        ExactDefect{.name = "PaddingRead", .falsify = [](MatvecArguments& a) { a.n = a.row_stride; }, .tail = true},
        ExactDefect{.name = "FirstIgnored", .falsify = [](MatvecArguments& a) { a.first = 0; }, .of_panel = true},
        ExactDefect{.name = "LastRowDropped", .falsify = [](MatvecArguments& a) { --a.rows; }}),
    [](const auto& info) { return info.param.name; });

TEST_P(BrokenMatvecExact, FailsTheCheck) {
  const ExactDefect& defect = GetParam();
  test::ReplacedKernelDevice device(open_device("openmp"), "matvec_exact",
                                    [&](test::Launched& launch) { multiply(launch, defect); });
  std::size_t shown = 0;
  for (const KernelCheck& row : checked(device, "matvec_exact")) {
    const bool single = row.parameters.find("panel_rows=1 ") == std::string::npos;
    if (row.size < 15 || (defect.tail && row.size % 16 == 0) || (defect.of_panel && single)) continue;
    ++shown;
    EXPECT_EQ(row.status, CheckStatus::fail) << describe(row);
  }
  EXPECT_GT(shown, 5U);
}

TEST(BrokenMatvecExactTwin, PassesWithoutADefect) {
  test::ReplacedKernelDevice device(open_device("openmp"), "matvec_exact",
                                    [](test::Launched& launch) { multiply(launch, {}); });
  for (const KernelCheck& row : checked(device, "matvec_exact", 129)) {
    EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
  }
}

/// close_rows, with the values of one row or column after they were computed changed by `spoil`.
struct CloseDefect {
  std::string name;
  std::function<void(MatvecArguments&)> falsify = [](MatvecArguments&) {};
  std::function<void(float& f, float s)> spoil = [](float&, float) {};
  bool counts_zeros = false;
  bool wrong_row = false;  ///< takes the next row's factor
};

void close(test::Launched& launch, const CloseDefect& defect) {
  auto a = launch.as<MatvecArguments>();
  const std::uint32_t vector_stride = a.vector_stride;
  defect.falsify(a);
  for (std::size_t r = 0; r < a.rows; ++r) {
    float low = std::numeric_limits<float>::max(), high = 0, count = 0;
    const float by = launch.buffers[2].at(a.first + r + (defect.wrong_row ? 1 : 0));
    for (std::size_t j = 0; j < a.n; ++j) {
      float& f = launch.buffers[0].at(r * a.row_stride + j);
      const float s = f, d = launch.buffers[1].at(j);
      if (s != 0 || defect.counts_zeros) {
        low = std::min(low, d);
        high = std::max(high, d);
        ++count;
      }
      f = s * (by * d);
      defect.spoil(f, s);
    }
    const float of_row[] = {low, high, count};
    for (std::size_t k = 0; k < 3; ++k) launch.buffers[3].at(k * vector_stride + a.first + r) = of_row[k];
  }
}

class BrokenCloseRows : public testing::TestWithParam<CloseDefect> {};
INSTANTIATE_TEST_SUITE_P(
    Twin, BrokenCloseRows,
    testing::Values(CloseDefect{.name = "LastColumnForgotten", .falsify = [](MatvecArguments& a) { --a.n; }},
                    CloseDefect{.name = "LastRowForgotten", .falsify = [](MatvecArguments& a) { --a.rows; }},
                    CloseDefect{.name = "FourRoundings",
                                .spoil = [](float& f, float) { f = std::nextafter(std::nextafter(f, 9e9F), 9e9F); }},
                    CloseDefect{.name = "NotClosed", .spoil = [](float& f, float s) { f = s; }},
                    CloseDefect{.name = "ZerosCounted", .counts_zeros = true},
                    CloseDefect{.name = "FactorOfTheNextRow", .wrong_row = true}),
    [](const auto& info) { return info.param.name; });

TEST_P(BrokenCloseRows, FailsTheCheck) {
  const CloseDefect& defect = GetParam();
  test::ReplacedKernelDevice device(open_device("openmp"), "close_rows",
                                    [&](test::Launched& launch) { close(launch, defect); });
  for (const KernelCheck& row : checked(device, "close_rows")) {
    if (row.size < 15) continue;
    EXPECT_EQ(row.status, CheckStatus::fail) << describe(row);
  }
}

TEST(BrokenCloseRowsTwin, PassesWithoutADefect) {
  test::ReplacedKernelDevice device(open_device("openmp"), "close_rows",
                                    [](test::Launched& launch) { close(launch, {}); });
  for (const KernelCheck& row : checked(device, "close_rows"))
    EXPECT_EQ(row.status, CheckStatus::pass) << describe(row);
}

}  // namespace
}  // namespace interflect
