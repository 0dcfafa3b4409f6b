#include "interflect/formfactor/form_factor_matrix.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "interflect/base/error.h"
#include "interflect/formfactor/simd.h"

namespace interflect {
namespace {

TEST(FormFactorMatrix, PanelsCoverTheRowsAndThePaddingIsZero) {
  FormFactorMatrix f(100, 3000);  // a row is 112 elements, 448 bytes: 6 rows a panel
  EXPECT_EQ(f.stride(), 112U);
  EXPECT_EQ(f.panels().size(), 17U);
  std::uint32_t next = 0;
  for (const Panel& panel : f.panels()) {
    EXPECT_EQ(panel.first, next);
    next += panel.rows;
    EXPECT_LE(panel.data->size(), 3000U);
  }
  EXPECT_EQ(next, 100U);
  EXPECT_EQ(f.bytes(), FormFactorMatrix::predicted_bytes(100));
  for (std::uint32_t i = 0; i < 100; ++i) {
    for (float& x : f.row(i)) x = static_cast<float>(i);
  }
  EXPECT_EQ(f.row(99)[99], 99);
  EXPECT_EQ(f.row(98).data()[100], 0) << "padding";
  EXPECT_EQ(f.row_sums()[7], 700);
  EXPECT_NEAR(f.nonzero_fraction(), 0.99, 1e-12);
}

TEST(FormFactorMatrix, AWrongPanelSizeIsAUsageError) {
  ::setenv("INTERFLECT_MAX_PANEL_BYTES", "many", 1);
  EXPECT_THROW((void)FormFactorMatrix::default_panel_bytes(), Error);
  ::unsetenv("INTERFLECT_MAX_PANEL_BYTES");
  EXPECT_EQ(FormFactorMatrix::default_panel_bytes(), std::uint64_t{1} << 30);
}

TEST(Simd, DotAndScaleAtAllLengths) {
  for (std::size_t n : {1U, 15U, 16U, 31U, 100U, 1023U, 1024U, 1025U, 3000U}) {
    std::vector<float> row(n), x(n);
    double exact = 0;
    for (std::size_t j = 0; j < n; ++j) {
      row[j] = j % 5 == 0 ? 0 : static_cast<float>(j % 7) + 1;
      x[j] = 1 + static_cast<float>(j % 3);
      exact += static_cast<double>(row[j] * x[j]);
    }
    EXPECT_NEAR(simd::dot(row, x), exact, 1e-6 * exact);
    std::vector<float> scaled = row;
    const auto extremes = simd::scale(scaled, 2, x);
    float low = 1e9F, high = 0;
    for (std::size_t j = 0; j < n; ++j) {
      ASSERT_EQ(scaled[j], row[j] * 2 * x[j]);
      if (row[j] != 0) low = std::min(low, x[j]), high = std::max(high, x[j]);
    }
    if (high > 0) {
      EXPECT_EQ(extremes.low, low);
    }
    EXPECT_EQ(extremes.high, high);
  }
}

}  // namespace
}  // namespace interflect
