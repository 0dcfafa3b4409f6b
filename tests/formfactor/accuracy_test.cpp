#include "interflect/formfactor/accuracy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "formfactor/broken.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/estimate.h"
#include "interflect/formfactor/shadow_rays.h"

namespace interflect {
namespace {

using test::Builder;
using test::near;
using ::testing::HasSubstr;

TEST(Accuracy, NamesAndNumbers) {
  EXPECT_EQ(accuracy_of("low").eps, 2e-2);
  EXPECT_EQ(accuracy_of("medium").eps, 5e-3);
  EXPECT_EQ(accuracy_of("high").eps, 1e-3);
  EXPECT_EQ(accuracy_of("3e-3").eps, 3e-3);
  EXPECT_EQ(accuracy_of("0.5").eps, 0.5);
  for (const char* text : {"low", "medium", "high", "0.003"}) EXPECT_EQ(text_of(accuracy_of(text)), text);
  for (const char* text : {"", "best", "Medium", "0", "-1e-3", "0.51", "nan", "inf", "1e-3x", " 1e-3", "1e-400"}) {
    try {
      (void)accuracy_of(text);
      ADD_FAILURE() << "no error: '" << text << "'";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::usage);
      EXPECT_THAT(error.what(), HasSubstr(std::string("'") + text + "'"));
    }
  }
}

TEST(Accuracy, TheBudgetGrowsWithIt) {
  const RayBudget medium = budget_of({5e-3}), defaults;
  EXPECT_FLOAT_EQ(medium.rays_per_factor, 10000);
  EXPECT_EQ(medium.most_in_pilot, defaults.most_in_pilot);
  EXPECT_EQ(medium.fewest_when_mixed, defaults.fewest_when_mixed);
  EXPECT_EQ(medium.most, defaults.most);
  EXPECT_FLOAT_EQ(medium.split_from, defaults.split_from);
  EXPECT_FLOAT_EQ(medium.ratios.three_points, defaults.ratios.three_points);
  RayBudget before = budget_of({0.5});
  for (const double eps : {2e-2, 5e-3, 1e-3, 5e-4, 2e-4}) {
    const RayBudget budget = budget_of({eps});
    EXPECT_FLOAT_EQ(budget.rays_per_factor, static_cast<float>(0.25 / (eps * eps)));
    EXPECT_FLOAT_EQ(budget.pilot_per_factor, budget.rays_per_factor / 5);
    EXPECT_GE(budget.most_in_pilot, before.most_in_pilot);
    EXPECT_GE(budget.most, before.most);
    EXPECT_LE(budget.most, 65536U) << "what one invocation of a kernel may loop";
    EXPECT_GE(budget.fewest_when_mixed, before.fewest_when_mixed);
    EXPECT_LE(budget.split_from, before.split_from);
    EXPECT_GE(budget.ratios.three_points, before.ratios.three_points);
    EXPECT_GE(budget.ratios.six_points, before.ratios.six_points);
    before = budget;
  }
}

/// The row sums, and the rms error of one that the tiles' variances give.
struct Result {
  std::vector<double> row_sum;
  double estimate = 0;
};
Result compute(const PatchMesh& mesh, double eps, std::uint64_t seed) {
  AssemblyOptions options = test::raw(seed);
  options.budget = budget_of({eps});
  const AssemblyReport report = assemble(mesh, options).report;
  return {report.row_sum_before, row_sum_error(report.tile_variance, mesh.area).rms};
}

double rms(const Result& a, const Result& b) {
  double squares = 0;
  for (std::size_t i = 0; i < a.row_sum.size(); ++i) squares += std::pow(a.row_sum[i] - b.row_sum[i], 2);
  return std::sqrt(squares / static_cast<double>(a.row_sum.size()));
}

/// The estimate within a factor of two of the truth.
::testing::AssertionResult calibrated(double estimate, double truth) {
  const double ratio = estimate / truth;
  return (ratio >= 0.5 && ratio <= 2 ? ::testing::AssertionSuccess() : ::testing::AssertionFailure())
         << "estimated " << estimate << ", true " << truth << ", ratio " << ratio;
}

Builder occluded_plates() {
  Builder b;
  b.part("low").plate({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 8);
  b.part("high").plate({0, 0, 1}, {0, 1, 0}, {1, 0, 0}, 8);
  b.part("screen").plate({-3, -3, 0.5}, {3.5, 0, 0}, {0, 7, 0}, 1);
  return b;
}
Builder furnished() {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 6);
  b.part("box").box({1, 1, 0.2}, {2, 1.7, 1}, false, 2);
  b.part("ball").sphere({3, 2, 1.2}, 0.4, 2, false);
  return b;
}

TEST(Accuracy, TheEstimateIsTheTrueErrorWithinAFactorOfTwoAndBelowWhatWasAsked) {
  for (const Builder& b : {occluded_plates(), furnished()}) {
    const Result reference = compute(b.mesh(), 7e-4, 99);
    double coarser = std::numeric_limits<double>::infinity();
    for (const double eps : {2e-2, 5e-3, 2e-3}) {
      const Result result = compute(b.mesh(), eps, 1);
      const double truth = rms(result, reference);
      EXPECT_TRUE(calibrated(result.estimate, truth)) << eps;
      EXPECT_LT(truth, eps);
      EXPECT_LT(truth, 0.7 * coarser) << eps;
      coarser = truth;
      EXPECT_LT(result.estimate, eps);
      // Twins: a variance counted as if there were a sixteenth of the rays, or sixteen times as many.
      EXPECT_FALSE(calibrated(4 * result.estimate, truth)) << eps;
      EXPECT_FALSE(calibrated(result.estimate / 4, truth)) << eps;
    }
  }
}

/// Nothing in any shaft: nothing from rays, and little from quadrature.
TEST(Accuracy, WithoutOccludersOnlyTheQuadratureErrs) {
  Builder b;
  b.part("cube").box({0, 0, 0}, {1, 1, 1}, true, 4);
  const Result empty = compute(b.mesh(), 5e-3, 1);
  EXPECT_GT(empty.estimate, 0);
  EXPECT_LT(empty.estimate, 1e-4);
  double worst = 0;
  for (const double sum : empty.row_sum) worst = std::max(worst, std::abs(sum - 1));
  EXPECT_LT(worst, 1e-4);
  b.part("ball").sphere({0.5, 0.5, 0.5}, 0.2, 1, false);
  EXPECT_GT(compute(b.mesh(), 5e-3, 1).estimate, 3e-4) << "twin: something to hide behind";
}

/// By hand: two blocks, areas 1 and 4, so that σ²(F_ij) is the variance times 1, times 4 and a quarter, times 1.
TEST(Accuracy, TheRowErrorOfGivenVariances) {
  std::vector<double> area(64, 1.0);
  std::fill(area.begin() + 32, area.end(), 4.0);
  const std::vector<float> variance{0.5F, 2, 0.25F};
  EXPECT_NEAR(row_sum_error(variance, area).rms, std::sqrt((0.5 * 2 + 2 * 4.25 + 0.25 * 2) / 64), 1e-12);
  EXPECT_THROW((void)row_sum_error(std::vector<float>(2), area), Error);
  EXPECT_EQ(row_sum_error({}, {}).rms, 0);
}

/// The rays that SIMD makes are those of sampling::shadow_ray(), in order, less those of weight 0.
TEST(ShadowRays, InSimdTheyAreTheSame) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> d(-1, 1);
  const auto point = [&](double z) { return Vec3{d(random), d(random), z + 0.3 * d(random)}; };
  const auto equal = [](const sampling::ShadowRay& ray, const ShadowRays& got, std::size_t k) {
    const std::array<float, 6> want{ray.origin.x,    ray.origin.y,    ray.origin.z,
                                    ray.direction.x, ray.direction.y, ray.direction.z};
    for (std::size_t c = 0; c < 6; ++c) {
      const float have = c < 3 ? got.origin[c][k] : got.direction[c - 3][k];
      if (!(std::abs(have - want[c]) < 2e-6F)) return false;
    }
    return true;
  };
  constexpr float lift = 1e-5F;
  std::size_t left_out = 0;
  for (int round = 0; round < 20; ++round) {
    const auto polygon = [&](double z) { return kernel::Polygon({point(z), point(z), point(z)}); };
    const auto facet = [&](const kernel::Polygon& p, double up) {
      const Vec3 n = normalized(cross(p.corner[1] - p.corner[0], p.corner[2] - p.corner[0]));
      return sampling::Facet(p, n.z * up > 0 ? n : -n);
    };
    kernel::Polygon fan = polygon(0);
    if (round % 2 == 1) {  // a part left by a cut: a fan of two
      fan.corner[3] = fan.corner[0] + 0.8 * (fan.corner[2] - fan.corner[0]) + 0.1 * (fan.corner[0] - fan.corner[1]);
      fan.size = 4;
    }
    const sampling::Facet a = facet(fan, 1), b = facet(polygon(0.7), -1);
    const sampling::Square word_a = sampling::word(1, 17), word_b = sampling::word(2, 40);
    const sampling::Square from = sampling::start(word_a, 40), to = sampling::start(word_b, 17);
    ShadowRays got;
    simd::rays_of({a, b, from, to, 5, true}, 3, 37, lift, got);
    std::size_t at = 0;
    for (std::uint32_t k = 3; k < 40; ++k) {
      const sampling::ShadowRay ray = sampling::shadow_ray(a, b, from, to, k, lift);
      if (!(ray.weight > 0)) {
        ++left_out;
        continue;
      }
      ASSERT_LT(at, got.size);
      ASSERT_TRUE(equal(ray, got, at)) << k;
      ASSERT_NEAR(got.weight[at], ray.weight, 1e-4F * ray.weight);
      ASSERT_EQ(got.slot[at], 5U);
      ASSERT_FALSE(equal(sampling::shadow_ray(a, b, from, to, k + 1, lift), got, at)) << "twin: another ray";
      ++at;
    }
    ASSERT_EQ(at, got.size);
    // Ray 0 of a against a block: the lanes that are wanted, at their own words.
    FacetBlock columns;
    std::array<FirstRay, FacetBlock::block> wanted{};
    std::vector<sampling::Facet> others;
    for (std::uint32_t k = 0; k < FacetBlock::block; ++k) {
      others.push_back(facet(polygon(0.7), -1));
      columns.set(k, others.back(), sampling::word(2, 64 + k));
      wanted[k] = static_cast<FirstRay>(random() % 3);
    }
    got.size = at = 0;
    simd::first_rays(a, word_a, 17, columns, 64, wanted, 96, lift, got);
    for (std::uint32_t k = 0; k < FacetBlock::block; ++k) {
      if (wanted[k] == FirstRay::none) continue;
      const auto ray = sampling::shadow_ray(a, others[k], sampling::start(word_a, 64 + k),
                                            sampling::start(sampling::word(2, 64 + k), 17), 0, lift);
      if (!(ray.weight > 0)) continue;
      ASSERT_LT(at, got.size);
      ASSERT_TRUE(equal(ray, got, at)) << k;
      ASSERT_NEAR(got.weight[at], wanted[k] == FirstRay::plain ? 1 : ray.weight, 1e-4F * std::max(1.0F, ray.weight));
      ASSERT_EQ(got.slot[at], 96 + k);
      ++at;
    }
    ASSERT_EQ(at, got.size);
  }
  EXPECT_GT(left_out, 0U) << "some rays lie on the other's plane";
}

}  // namespace
}  // namespace interflect
