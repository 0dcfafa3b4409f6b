// Estimated errors against sums by hand, and against what other seeds give.
#include "interflect/formfactor/estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>

#include "formfactor/broken.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/assembly.h"

namespace interflect {
namespace {

using test::Builder;

/// Random variances and areas of 70 patches: 3 rows of tiles, the last one narrow.
struct Made {
  std::vector<float> variance = std::vector<float>(6);
  std::vector<double> area = std::vector<double>(70);
  std::vector<Rgb> reflectance = std::vector<Rgb>(70), radiosity = std::vector<Rgb>(70);
  Made() {
    std::mt19937 random(3);  // NOLINT: the same numbers every time
    std::uniform_real_distribution<double> share(0.1, 1);
    for (float& v : variance) v = static_cast<float>(share(random));
    for (std::size_t i = 0; i < 70; ++i) {
      area[i] = share(random);
      for (std::size_t c = 0; c < 3; ++c) {
        reflectance[i][c] = share(random);
        radiosity[i][c] = share(random);
      }
    }
  }
  /// σ²(F_ij), pair by pair.
  [[nodiscard]] double square(std::size_t i, std::size_t j) const {
    if (i == j) return 0;
    const std::size_t r = std::min(i, j) / 32, c = std::max(i, j) / 32;
    const auto height = static_cast<double>(r == 2 ? 6 : 32), width = static_cast<double>(c == 2 ? 6 : 32);
    const double pairs = r == c ? height * (height - 1) / 2 : height * width;
    const std::size_t tile = r == 0 ? c : r == 1 ? 2 + c : 5;
    return static_cast<double>(variance[tile]) / pairs * area[j] / area[i];
  }
};

TEST(Estimate, RowSumsAsSummedByPairs) {
  const Made m;
  double rms = 0, largest = 0;
  for (std::size_t i = 0; i < 70; ++i) {
    double sum = 0;
    for (std::size_t j = 0; j < 70; ++j) sum += m.square(i, j);
    rms += sum / 70;
    largest = std::max(largest, std::sqrt(sum));
  }
  const EstimatedError error = row_sum_error(m.variance, m.area);
  EXPECT_NEAR(error.rms, std::sqrt(rms), 1e-12);
  EXPECT_NEAR(error.max, largest, 1e-12);
  EXPECT_THROW((void)row_sum_error(std::span(m.variance).first(5), m.area), Error);
}

TEST(Estimate, RadiositiesAsSummedByPairs) {
  const Made m;
  double worst_rms = 0, worst = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    double rms = 0, largest = 0;
    for (const Rgb& b : m.radiosity) largest = std::max(largest, b[c]);
    for (std::size_t i = 0; i < 70; ++i) {
      double sum = 0;
      for (std::size_t j = 0; j < 70; ++j) sum += m.square(i, j) * m.radiosity[j][c] * m.radiosity[j][c];
      const double here = m.reflectance[i][c] * std::sqrt(sum) / largest;
      rms += here * here / 70;
      worst = std::max(worst, here);
    }
    worst_rms = std::max(worst_rms, std::sqrt(rms));
  }
  const EstimatedError error = radiosity_error(m.variance, m.area, m.reflectance, m.radiosity);
  EXPECT_NEAR(error.rms, worst_rms, 1e-12);
  EXPECT_NEAR(error.max, worst, 1e-12);
}

TEST(Estimate, NoVarianceNoError) {
  Made m;
  m.variance.assign(6, 0.0F);
  EXPECT_EQ(row_sum_error(m.variance, m.area).max, 0.0);
  EXPECT_EQ(radiosity_error(m.variance, m.area, m.reflectance, m.radiosity).max, 0.0);
  m.radiosity.assign(70, Rgb{});
  EXPECT_EQ(radiosity_error(m.variance, m.area, m.reflectance, m.radiosity).max, 0.0) << "no light";
}

}  // namespace
}  // namespace interflect
