// Estimated errors against sums by hand, and against what other seeds give.
#include "interflect/formfactor/estimate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <numeric>
#include <random>

#include "formfactor/broken.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/assembly.h"

namespace interflect {
namespace {

using test::Builder;

/// Random variances and areas of 70 patches: 3 rows of tiles, the last one narrow. Many areas are equal.
struct Made {
  std::vector<float> variance = std::vector<float>(6);
  std::vector<double> area = std::vector<double>(70);
  std::vector<Rgb> reflectance = std::vector<Rgb>(70), radiosity = std::vector<Rgb>(70);
  Made() {
    std::mt19937 random(3);  // NOLINT: the same numbers every time
    std::uniform_real_distribution<double> share(0.1, 1);
    for (float& v : variance) v = static_cast<float>(share(random));
    for (std::size_t i = 0; i < 70; ++i) {
      area[i] = i % 3 == 0 ? 0.5 : share(random);
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
    double all = 0;
    for (std::size_t a = 32 * r; a < std::min<std::size_t>(70, 32 * r + 32); ++a) {
      for (std::size_t b = r == c ? a + 1 : 32 * c; b < std::min<std::size_t>(70, 32 * c + 32); ++b) {
        all += std::min(area[a], area[b]);
      }
    }
    const std::size_t tile = r == 0 ? c : r == 1 ? 2 + c : 5;
    return static_cast<double>(variance[tile]) * std::min(area[i], area[j]) / all * area[j] / area[i];
  }
};

TEST(Estimate, RowSumsAsSummedByPairs) {
  const Made m;
  const std::vector<double> errors = row_errors(m.variance, m.area);
  ASSERT_EQ(errors.size(), 70U);
  double rms = 0, largest = 0;
  for (std::size_t i = 0; i < 70; ++i) {
    double sum = 0;
    for (std::size_t j = 0; j < 70; ++j) sum += m.square(i, j);
    EXPECT_NEAR(errors[i], std::sqrt(sum), 1e-12) << i;
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

TEST(Estimate, TheNumberOfThreadsChangesNoBit) {
  const Made m;
  const int threads = omp_get_max_threads();
  std::vector<std::vector<double>> rows;
  std::vector<double> radiosity;
  for (const int used : {1, 2, 3, 7}) {
    omp_set_num_threads(used);
    rows.push_back(row_errors(m.variance, m.area));
    radiosity.push_back(radiosity_error(m.variance, m.area, m.reflectance, m.radiosity).rms);
  }
  omp_set_num_threads(threads);
  EXPECT_THAT(rows, testing::Each(rows.front()));
  EXPECT_THAT(radiosity, testing::Each(radiosity.front()));
}

TEST(Estimate, NoVarianceNoError) {
  Made m;
  m.variance.assign(6, 0.0F);
  EXPECT_EQ(row_sum_error(m.variance, m.area).max, 0.0);
  EXPECT_EQ(radiosity_error(m.variance, m.area, m.reflectance, m.radiosity).max, 0.0);
  m.radiosity.assign(70, Rgb{});
  EXPECT_EQ(radiosity_error(m.variance, m.area, m.reflectance, m.radiosity).max, 0.0) << "no light";
}

/// b = e + ρ F b, by as many bounces as it takes.
std::vector<Rgb> light(const FormFactorMatrix& f, const PatchMesh& mesh) {
  std::vector<Rgb> b = mesh.emittance;
  for (int bounce = 0; bounce < 40; ++bounce) {
    std::vector<Rgb> next = mesh.emittance;
    for (std::uint32_t i = 0; i < f.size(); ++i) {
      const auto row = f.row(i);
      for (std::size_t c = 0; c < 3; ++c) {
        double sum = 0;
        for (std::size_t j = 0; j < row.size(); ++j) sum += static_cast<double>(row[j]) * b[j][c];
        next[i][c] += mesh.reflectance[i][c] * sum;
      }
    }
    b = next;
  }
  return b;
}

/// What other seeds give differs by about as much as is estimated: rms over the patches and seeds.
TEST(Estimate, AgreesWithOtherSeeds) {
  Builder builder;
  builder.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 3);
  builder.part("box").box({1, 1, 0.2}, {2, 1.7, 1}, false, 2);
  builder.part("other").box({2.6, 1.2, 0.3}, {3.2, 2.4, 1.9}, false, 1);
  PatchMesh mesh = builder.mesh();
  for (std::size_t i = 0; i < mesh.size(); ++i) mesh.emittance[i] = i < 18 ? Rgb{1, 1, 1} : Rgb{};
  constexpr std::uint64_t seeds = 8;
  std::vector<std::vector<double>> sums;
  std::vector<std::vector<Rgb>> lights;
  EstimatedError rows, radiosity;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    AssemblyOptions options;
    options.closure = Closure::off;
    options.seed = seed;
    options.budget = budget_of({2e-2});
    const FormFactors made = assemble(mesh, options);
    sums.push_back(made.report.row_sum);
    lights.push_back(light(made.matrix, mesh));
    if (seed > 1) continue;
    rows = row_sum_error(made.report.tile_variance, mesh.area);
    radiosity = radiosity_error(made.report.tile_variance, mesh.area, mesh.reflectance, lights.front());
  }
  double of_rows = 0, of_light = 0, largest = 0;
  for (const Rgb& b : lights.front()) largest = std::max(largest, b[0]);
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    double mean = 0, mean_light = 0;
    for (std::size_t s = 0; s < seeds; ++s) {
      mean += sums[s][i] / seeds;
      mean_light += lights[s][i][0] / seeds;
    }
    for (std::size_t s = 0; s < seeds; ++s) {
      of_rows += std::pow(sums[s][i] - mean, 2);
      of_light += std::pow((lights[s][i][0] - mean_light) / largest, 2);
    }
  }
  const double degrees = static_cast<double>(mesh.size()) * (seeds - 1);
  of_rows = std::sqrt(of_rows / degrees);
  of_light = std::sqrt(of_light / degrees);
  const auto agree = [](double estimate, double measured) {
    return estimate < 3 * measured && measured < 1.5 * estimate;
  };
  EXPECT_TRUE(agree(rows.rms, of_rows)) << rows.rms << " estimated, " << of_rows << " measured";
  EXPECT_TRUE(agree(radiosity.rms, of_light)) << radiosity.rms << " estimated, " << of_light << " measured";
  EXPECT_GT(rows.max, rows.rms);
  // Twins: variances that are ten times off either way.
  EXPECT_FALSE(agree(rows.rms * std::sqrt(10.0), of_rows));
  EXPECT_FALSE(agree(rows.rms / std::sqrt(10.0), of_rows));
}

}  // namespace
}  // namespace interflect
