#include "interflect/formfactor/assembly.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>

#include "formfactor/broken.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/closure.h"
#include "interflect/formfactor/estimate.h"

namespace interflect {
namespace {

using test::Builder;
using test::raw;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

/// A closed room with a box standing free in it and a ball: everything that the assembly knows occurs.
Builder room() {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 4);
  b.part("box").box({1, 1, 0.2}, {2, 1.7, 1}, false, 2);
  b.part("ball").sphere({3, 2, 1.2}, 0.4, 2, false);
  return b;
}

std::vector<float> elements(const FormFactorMatrix& f) {
  std::vector<float> all;
  for (std::uint32_t i = 0; i < f.size(); ++i) all.insert(all.end(), f.row(i).begin(), f.row(i).end());
  return all;
}

double worst_asymmetry(const PatchMesh& mesh, const FormFactorMatrix& f) {
  double worst = 0;
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    for (std::uint32_t j = 0; j < i; ++j) {
      const double a = mesh.area[i] * static_cast<double>(f.row(i)[j]);
      const double b = mesh.area[j] * static_cast<double>(f.row(j)[i]);
      if (a != b) worst = std::max(worst, std::abs(a - b) / std::max(a, b));
    }
  }
  return worst;
}

TEST(Assembly, ReciprocityIsExactToRounding) {
  const Builder b = room();
  EXPECT_LT(worst_asymmetry(b.mesh(), assemble(b.mesh(), raw()).matrix), 2.4e-7)
      << "two roundings of fp32 on each side";
  EXPECT_LT(worst_asymmetry(b.mesh(), assemble(b.mesh()).matrix), 4.8e-7) << "and two more by the closure";
}

TEST(Assembly, SameBitsForAnyNumberOfThreadsAndAnyPanels) {
  const Builder b = room();
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const std::vector<float> one = elements(assemble(b.mesh()).matrix);
  omp_set_num_threads(4);
  const std::vector<float> four = elements(assemble(b.mesh()).matrix);
  omp_set_num_threads(threads);
  EXPECT_EQ(one, four);
  ::setenv("INTERFLECT_MAX_PANEL_BYTES", "20000", 1);
  const FormFactors small = assemble(b.mesh());
  ::unsetenv("INTERFLECT_MAX_PANEL_BYTES");
  EXPECT_GT(small.matrix.panels().size(), 20U);
  EXPECT_EQ(one, elements(small.matrix));
}

TEST(Assembly, SeedsAgreeWithinTheSamplingError) {
  const Builder b = room();
  const auto one = b.factors(raw(1)), two = b.factors(raw(2));
  bool differ = false;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(one.factors[r][c], two.factors[r][c], 2e-3) << r << c;
      differ = differ || one.factors[r][c] != two.factors[r][c];
    }
  }
  EXPECT_TRUE(differ) << "the seed must reach the samples";
}

TEST(Assembly, AClosedRoomIsFoundClosedAndItsRowsAreNearOneBefore) {
  const Builder b = room();
  const FormFactors f = assemble(b.mesh());
  EXPECT_TRUE(f.report.closed_scene);
  EXPECT_EQ(f.report.escape_fraction, 0);
  EXPECT_TRUE(f.report.closure_applied);
  EXPECT_NEAR(f.report.before.mean, 1, 2e-3);
  EXPECT_GT(f.report.before.min, 0.95);
  EXPECT_LT(f.report.before.max, 1.05);
  EXPECT_NEAR(f.report.after.min, 1, 1e-4);
  EXPECT_NEAR(f.report.after.max, 1, 1e-4);
  EXPECT_TRUE(f.report.set_aside.empty());
  EXPECT_GT(f.report.rays, f.report.pairs_considered / 2);
  EXPECT_GT(f.report.pairs_analytic, 0U);
  // Twin: without visibility the same bounds on the row sums do not hold.
  double mean = 0, max = 0;
  for (const double sum : test::blind(b.mesh()).row_sums()) {
    mean += sum / static_cast<double>(b.mesh().size());
    max = std::max(max, sum);
  }
  EXPECT_FALSE(test::near(mean, 1, 2e-3));
  EXPECT_GT(max, 1.05);
  const FormFactors before = assemble(b.mesh(), raw());
  for (std::uint32_t i = 0; i < f.matrix.size(); ++i) {
    for (std::uint32_t j = 0; j < f.matrix.size(); ++j) {
      ASSERT_GE(f.matrix.row(i)[j], 0);
      ASSERT_EQ(f.matrix.row(i)[j] == 0, before.matrix.row(i)[j] == 0) << "zero stays zero";
    }
  }
}

TEST(Assembly, AnOpenSceneKeepsItsRemainder) {
  Builder b;
  b.part("low").plate({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 4);
  b.part("high").plate({0, 0, 1}, {0, 1, 0}, {1, 0, 0}, 4);
  const FormFactors f = assemble(b.mesh());
  EXPECT_FALSE(f.report.closed_scene);
  EXPECT_FALSE(f.report.closure_applied);
  EXPECT_NEAR(f.report.escape_fraction, 1 - 0.199824895698387, 5e-3);
  EXPECT_NEAR(f.report.after.mean, 0.199824895698387, 1e-4);
  AssemblyOptions forced;
  forced.closure = Closure::on;
  const FormFactors closed = assemble(b.mesh(), forced);
  EXPECT_NEAR(closed.report.after.min, 1, 1e-4);
  ASSERT_FALSE(closed.report.warnings.empty());
  EXPECT_THAT(closed.report.warnings[0], HasSubstr("open scene"));
}

/// A plate flush inside a crate: nothing but the crate's inner sides to see, which are backs.
TEST(Assembly, BuriedPatchesAreSetAsideAndNamed) {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 4, 3}, true, 4);
  b.part("crate").box({1, 1, 0.5}, {2, 2, 1.5}, false, 2);
  const std::size_t first = b.mesh().size();
  b.part("inside").plate({1.2, 1.2, 0.8}, {0.5, 0, 0}, {0, 0.5, 0}, 1);
  const FormFactors f = assemble(b.mesh());
  EXPECT_TRUE(f.report.closed_scene);
  EXPECT_EQ(f.report.set_aside,
            (std::vector<std::uint32_t>{static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(first + 1)}));
  for (std::size_t i = 0; i < first; ++i) EXPECT_NEAR(f.report.row_sum[i], 1, 1e-4);
  EXPECT_EQ(f.report.row_sum[first], 0);
  EXPECT_THAT(f.report.warnings, ::testing::Contains(EndsWith("are left out of the closure: inside 2")));
}

TEST(Assembly, ManyObjectsWithBuriedPatchesTheThreeWithMostAreNamed) {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 4, 3}, true, 4);
  b.part("crate").box({1, 1, 0.5}, {2, 2, 1.5}, false, 2);
  const int cells[] = {1, 3, 2, 1};
  for (int k = 0; k < 4; ++k) {
    b.part("layer" + std::to_string(k)).plate({1.2, 1.2, 0.7 + 0.1 * k}, {0.5, 0, 0}, {0, 0.5, 0}, cells[k]);
  }
  EXPECT_THAT(assemble(b.mesh()).report.warnings,
              ::testing::Contains(AllOf(StartsWith("30 patches see next to nothing"),
                                        EndsWith(": layer1 18, layer2 8, layer0 2, ..."))));
}

/// Two plates in the open, their closure forced: it has to move a lot, and says where.
TEST(Assembly, WhereTheClosureMovedMuchIsNamed) {
  Builder b;
  b.part("low").plate({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 2);
  b.part("high").plate({0, 0, 1}, {0, 1, 0}, {1, 0, 0}, 2);
  AssemblyOptions forced;
  forced.closure = Closure::on;
  EXPECT_THAT(assemble(b.mesh(), forced).report.warnings,
              ::testing::Contains(
                  AllOf(HasSubstr("and the row sums of 16 patches by more than 5 %"), EndsWith(": high 8, low 8"))));
}

/// The report of S_ij = s for all pairs, with the same variance in every tile.
AssemblyReport report_of(const PatchMesh& mesh, double s, float variance = 0) {
  class Even final : public TileMaker {
   public:
    Even(float s, float variance) : s_(32 * 32, s), variance_(variance) {}
    TileFacts make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink&) override {
      constexpr std::size_t blocks = 2;
      for (std::size_t r = first; r < end; ++r) {
        for (std::size_t c = r; c < blocks; ++c) sink(r, c, s_);
      }
      TileFacts facts;
      facts.variance.assign(tiles_in_rows(first, end, blocks), variance_);
      return facts;
    }

   private:
    std::vector<float> s_;
    float variance_;
  };
  EXPECT_EQ((mesh.size() + 31) / 32, 2U);
  AssemblyOptions options;
  options.maker = [&](const PatchTable&, const Blockers&) {
    return std::make_unique<Even>(static_cast<float>(s), variance);
  };
  return assemble(mesh, options).report;
}

/// The inside of a cube whose rows all sum to `sum` before the closure, each factor alike.
AssemblyReport report_of_rows(double sum) {
  const PatchMesh mesh = Builder().part("walls").box({0, 0, 0}, {1, 1, 1}, true, 2).mesh();
  return report_of(mesh, sum * mesh.area[0] / 47);
}

/// d is 1.043 everywhere where rows sum to 0.92: 4.3 % off 1, and yet every factor moves by d² - 1 = 8.7 %.
TEST(Assembly, WhatMovedIsTheFactorsNotD) {
  const AssemblyReport much = report_of_rows(0.92);
  EXPECT_LT(much.scaling[0], 1.05);
  EXPECT_NEAR(much.closure_max_change, 1 / 0.92 - 1, 1e-4);
  EXPECT_EQ(much.moved().size(), 48U);
  EXPECT_NEAR(much.row_change(7), 1 / 0.92 - 1, 1e-4);
  EXPECT_THAT(much.warnings,
              ::testing::ElementsAre(
                  "closure moved a factor by 8.7 %, and the row sums of 48 patches by more than 5 %: walls 48"));
  const AssemblyReport little = report_of_rows(0.96);
  EXPECT_THAT(little.moved(), ::testing::IsEmpty());
  EXPECT_THAT(little.warnings, ::testing::IsEmpty());
}

TEST(Assembly, AFactorThatMovedMuchInARowThatDidNotIsSaid) {
  const PatchMesh mesh = Builder().part("walls").box({0, 0, 0}, {1, 1, 1}, true).mesh();
  AssemblyReport report;
  report.row_sum_before = std::vector<double>(mesh.size(), 0.97);
  report.row_sum = std::vector<double>(mesh.size(), 1.0);
  Scaling scaling;
  scaling.max_change = 0.08;
  note_change(mesh, scaling, report);
  EXPECT_THAT(report.warnings, ::testing::ElementsAre("closure moved a factor by 8.0 %, but the row sum of no patch by "
                                                      "more than 5 %"));
}

/// The errors that the certificate judges by are those that the reports estimate.
TEST(Assembly, TheCertificateHasTheEstimatedErrors) {
  const PatchMesh mesh = Builder().part("walls").box({0, 0, 0}, {4, 3, 2}, true, 2).mesh();
  const AssemblyReport report = report_of(mesh, 0.02, 0.5F);
  const std::vector<double> errors = row_errors(report.tile_variance, mesh.area);
  EXPECT_GT(*std::min_element(errors.begin(), errors.end()), 5e-3) << "the accuracy is the least";
  ASSERT_FALSE(report.certificate.worst.empty());
  for (const SuspectRow& row : report.certificate.worst) EXPECT_EQ(row.error, errors[row.patch]) << row.patch;
  const AssemblyReport exact = report_of(mesh, 0.02, 0);
  for (const SuspectRow& row : exact.certificate.worst) EXPECT_EQ(row.error, 5e-3) << row.patch;
}

TEST(Assembly, ATwoSidedPlateHasNoBack) {
  Builder b;
  b.part("walls").box({0, 0, 0}, {2, 2, 2}, true, 4);
  b.part("front").plate({0.5, 0.5, 1}, {1, 0, 0}, {0, 1, 0}, 2);
  EXPECT_GT(assemble(b.mesh()).report.back_fraction, 0.01);
  // The same triangles turned around, sharing their vertices, as subdivide() makes them.
  b.part("behind");
  const PatchMesh& mesh = b.mesh();
  for (std::size_t i = 0, n = mesh.size(); i < n; ++i) {
    const auto t = mesh.triangle(i);
    if (mesh.surface[i] == 1) b.triangle(t[0], t[2], t[1]);
  }
  const FormFactors f = assemble(mesh);
  EXPECT_EQ(f.report.back_fraction, 0);
  EXPECT_TRUE(f.report.closed_scene);
  EXPECT_NEAR(f.report.before.mean, 1, 2e-3);
  const GroupFactors groups = between(f.matrix, mesh, b.grouping());
  EXPECT_EQ(groups.factors[1][2], 0) << "the two sides do not see each other";
  EXPECT_NEAR(groups.factors[1][0], 1, 1e-4);
  EXPECT_NEAR(groups.factors[2][0], 1, 1e-4);
}

TEST(Assembly, TooLittleMemoryIsSaidBeforeAnyWork) {
  const Builder b = room();
  AssemblyOptions options;
  options.memory_limit = 100000;
  try {
    (void)assemble(b.mesh(), options);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::limit);
    EXPECT_THAT(error.what(), HasSubstr("--divide"));
    EXPECT_THAT(error.what(), HasSubstr("MiB"));
    EXPECT_THAT(error.what(), HasSubstr(std::to_string(b.mesh().size())));
  }
}

class Counter : public ProgressSink {
 public:
  void begin(std::string_view, std::uint64_t total) override { total_ += total; }
  void advance(std::uint64_t steps) override { done_ += steps; }
  std::uint64_t total_ = 0;
  std::atomic<std::uint64_t> done_ = 0;
};

TEST(Assembly, ProgressReachesItsTotal) {
  Counter counter;
  (void)assemble(room().mesh(), {}, &counter);
  EXPECT_GT(counter.total_, 1U);
  EXPECT_EQ(counter.done_, counter.total_);
}

/// What an exception in a worker does: it must come out of assemble() as itself, not end the program.
TEST(Assembly, AnExceptionOfAWorkerComesOut) {
  class Thrower : public ProgressSink {
   public:
    void advance(std::uint64_t) override { throw Error(ErrorKind::internal, "stop"); }
  } thrower;
  EXPECT_THROW((void)assemble(room().mesh(), {}, &thrower), Error);
}

/// λ = −1: two plates that see only each other, sums off by 10 %.
TEST(Closure, TwoPlatesThatSeeOnlyEachOther) {
  constexpr std::uint32_t n = 40;
  FormFactorMatrix f(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      if ((i < n / 2) != (j < n / 2)) f.row(i)[j] = (1 + 0.1F * std::sin(static_cast<float>(i * j))) / (n / 2.0F);
    }
  }
  const std::vector<double> area(n, 1.0);
  Scaling done = scale_to_closure(exchange_product(f), area, std::vector<bool>(n, true), 2e-5);
  make_form_factors(f, area, done);
  EXPECT_LT(done.residual, 2e-5);
  EXPECT_LT(done.iterations, 60U);
  for (const double sum : f.row_sums()) EXPECT_NEAR(sum, 1, 1e-4);
}

/// Two patches of unequal area that see only each other have no solution: bounded, and reported.
TEST(Closure, AnImpossibleGoalEndsAndIsReported) {
  FormFactorMatrix f(2);
  f.row(0)[1] = f.row(1)[0] = 0.5F;
  Scaling done = scale_to_closure(exchange_product(f), {1, 2}, {true, true}, 2e-5);
  make_form_factors(f, {1, 2}, done);
  EXPECT_GT(done.residual, 1e-4);
  EXPECT_LE(done.iterations, 250U);
  for (const double sum : f.row_sums()) {
    EXPECT_TRUE(std::isfinite(sum));
    EXPECT_GE(sum, 0);
  }
}

TEST(Closure, CapOnlyLowers) {
  FormFactorMatrix f(3);
  f.row(0)[1] = 0.6F;
  f.row(0)[2] = 0.5F;
  f.row(1)[0] = 0.6F;
  f.row(2)[0] = 0.5F;
  Scaling done = cap_row_sums(f.row_sums());
  make_form_factors(f, {1, 1, 1}, done);
  EXPECT_LE(f.row_sums()[0], 1);
  EXPECT_NEAR(f.row_sums()[0], 1, 1e-6);
  EXPECT_EQ(f.row(0)[1], f.row(1)[0]);
  EXPECT_NEAR(done.max_change, 0.1 / 1.1, 1e-6);
}

}  // namespace
}  // namespace interflect
