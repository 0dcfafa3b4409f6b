#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/solver/solver.h"
#include "schedule/counting_device.h"
#include "solver/reference.h"
#include "solver/room.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::Le;

constexpr std::array methods{Method::cg, Method::bicgstab, Method::jacobi};

struct Solved {
  SolveReport report;
  Columns b;
};

Solved solved(const Room& room, const Light& light, Method method, const StopTest& stop = {}) {
  Scheduler scheduler(room.form_factors, openmp(), static_cast<std::uint32_t>(light.emittance.size()));
  Solved result;
  result.report = solve(scheduler, method, stop, room.area, light.reflectance, light.emittance, result.b);
  return result;
}

/// The reported residuals are those of the b that came back.
void expect_honest(const Room& room, const Light& light, const Solved& s, const StopTest& stop = {}) {
  bool within = true;
  for (std::size_t c = 0; c < s.b.size(); ++c) {
    const double residual = reference_residual(room.form_factors, light.reflectance[c], light.emittance[c], s.b[c]);
    EXPECT_NEAR(s.report.relative_residual[c], residual, 1e-6 * residual + 1e-13);
    within = within && residual <= stop.tolerance;
    for (const float b : s.b[c]) ASSERT_TRUE(std::isfinite(b));
  }
  EXPECT_EQ(s.report.converged, within);
  EXPECT_EQ(s.report.reason.empty(), within);
}

class EveryMethod : public ::testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Solve, EveryMethod, ::testing::ValuesIn(methods),
                         [](const auto& info) { return std::string(name(info.param)); });

TEST_P(EveryMethod, GivesTheReferenceSolutionFromDarkToBrightRooms) {
  const Room room = make_room(7, 4);
  for (const float bright : {0.3F, 0.9F, 0.99F}) {
    SCOPED_TRACE(bright);
    const Light light = lamp_light(room, bright);
    const Solved s = solved(room, light, GetParam());
    EXPECT_TRUE(s.report.converged);
    EXPECT_THAT(s.report.relative_residual, Each(Le(1e-6)));
    expect_honest(room, light, s);
    const Doubles exact = reference_solution(room.form_factors, light.reflectance, light.emittance);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(relative_to_maximum(s.b[c], exact[c]), 5e-6) << "column " << c;
  }
}

TEST(Solve, TheMethodsAgree) {
  const Room room = make_room(12, 6);
  const Light light = lamp_light(room, 0.9F);
  const Solved cg = solved(room, light, Method::cg);
  for (const Method other : {Method::bicgstab, Method::jacobi}) {
    const Solved s = solved(room, light, other);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(relative_to_maximum(s.b[c], cg.b[c]), 1e-5) << name(other);
  }
}

TEST(Solve, CgNeedsAtMostTwoFifthsOfTheProductsOfJacobi) {
  const Room room = make_room(12, 6);
  const Light light = lamp_light(room, 0.9F);
  const Solved cg = solved(room, light, Method::cg);
  const Solved bicgstab = solved(room, light, Method::bicgstab);
  const Solved jacobi = solved(room, light, Method::jacobi);
  EXPECT_LE(cg.report.products * 5, jacobi.report.products * 2);
  EXPECT_LE(bicgstab.report.products * 5, jacobi.report.products * 2);
  EXPECT_LE(cg.report.products, bicgstab.report.products);
}

TEST_P(EveryMethod, FurnaceGlowsEvenly) {
  const Room closed_room = make_room(6, 3);
  const Room ball = sphere(300);
  for (const Room* room : {&closed_room, &ball}) {
    const std::size_t n = room->area.size();
    const std::vector<double> row_sums = room->form_factors.row_sums();
    for (const float rho : {0.1F, 0.5F, 0.9F, 0.99F}) {
      const Light light{{std::vector<float>(n, rho)}, {std::vector<float>(n, 2.0F)}};
      const Solved s = solved(*room, light, GetParam());
      const double exact = 2.0 / (1.0 - static_cast<double>(rho));
      for (std::size_t i = 0; i < n; ++i) {
        // the floor under the boxes sees nothing
        const double expected = row_sums[i] == 0.0 ? 2.0 : exact;
        ASSERT_NEAR(static_cast<double>(s.b[0][i]), expected, 1e-4 * expected) << "rho " << rho << ", patch " << i;
      }
      expect_honest(*room, light, s);
      // at 0.99 b = 100 e, and rounding b to fp32 alone can leave more than 1e-6 of e
      EXPECT_TRUE(s.report.converged || rho > 0.95F) << s.report.reason;
    }
  }
}

TEST_P(EveryMethod, BlackPatchesGiveOutWhatTheyEmitExactly) {
  const Room room = make_room(6, 3);
  Light light = lamp_light(room, 0.8F);
  for (std::size_t i = 0; i < room.area.size(); i += 3) {
    light.reflectance[1][i] = 0.0F;  // in one channel only
    light.emittance[1][i] = 0.1F * static_cast<float>(i % 7);
  }
  const Solved s = solved(room, light, GetParam());
  EXPECT_TRUE(s.report.converged);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < room.area.size(); ++i) {
      if (light.reflectance[c][i] != 0.0F) continue;
      ASSERT_EQ(s.b[c][i], light.emittance[c][i]);
    }
  }
  const Doubles exact = reference_solution(room.form_factors, light.reflectance, light.emittance);
  EXPECT_LT(relative_to_maximum(s.b[1], exact[1]), 5e-6);
}

TEST_P(EveryMethod, TinyReflectancesDoNoHarm) {
  const Room room = make_room(5, 2);
  Light light = lamp_light(room, 0.7F);
  for (std::size_t i = 0; i < room.area.size(); ++i) {
    if (i % 3 == 0) light.reflectance[0][i] = 1e-30F;
    if (i % 3 == 1) light.reflectance[1][i] = 1e-6F;
  }
  const Solved s = solved(room, light, GetParam());
  EXPECT_TRUE(s.report.converged);
  const Doubles exact = reference_solution(room.form_factors, light.reflectance, light.emittance);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(relative_to_maximum(s.b[c], exact[c]), 5e-6);
}

TEST_P(EveryMethod, DarkColumnsAreSolvedAtOnce) {
  const Room room = make_room(5, 2);
  Light light = lamp_light(room, 0.8F);
  std::fill(light.emittance[1].begin(), light.emittance[1].end(), 0.0F);
  const Solved s = solved(room, light, GetParam());
  EXPECT_TRUE(s.report.converged);
  EXPECT_THAT(s.b[1], Each(0.0F));
  EXPECT_EQ(s.report.relative_residual[1], 0.0);
  const Doubles exact = reference_solution(room.form_factors, light.reflectance, light.emittance);
  EXPECT_LT(relative_to_maximum(s.b[0], exact[0]), 5e-6);

  for (auto& column : light.emittance) std::fill(column.begin(), column.end(), 0.0F);
  const Solved night = solved(room, light, GetParam());
  EXPECT_TRUE(night.report.converged);
  EXPECT_EQ(night.report.iterations, 0U);
  EXPECT_EQ(night.report.products, 0U);
  for (const auto& column : night.b) EXPECT_THAT(column, Each(0.0F));
}

TEST_P(EveryMethod, AColumnThatConvergesEarlyWaitsUnharmed) {
  const Room room = make_room(6, 3);
  Light light = lamp_light(room, 0.97F);
  for (float& rho : light.reflectance[0]) rho *= 0.05F;
  const Solved s = solved(room, light, GetParam());
  EXPECT_TRUE(s.report.converged);
  expect_honest(room, light, s);
  const Doubles exact = reference_solution(room.form_factors, light.reflectance, light.emittance);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(relative_to_maximum(s.b[c], exact[c]), 5e-6);
}

TEST_P(EveryMethod, UnitsDoNotMatter) {
  const Room room = make_room(5, 2);
  const Light light = lamp_light(room, 0.8F);
  const Solved s = solved(room, light, GetParam());
  for (const float unit : {0x1p-100F, 0x1p100F}) {  // powers of two change no digit
    Light scaled = light;
    for (auto& column : scaled.emittance) {
      for (float& e : column) e *= unit;
    }
    const Solved t = solved(room, scaled, GetParam());
    EXPECT_EQ(t.report.iterations, s.report.iterations);
    for (std::size_t i = 0; i < room.area.size(); ++i) ASSERT_EQ(t.b[0][i], s.b[0][i] * unit);
  }
}

TEST_P(EveryMethod, TheLimitOfIterationsEndsAsNotConverged) {
  const Room room = make_room(6, 3);
  const Light light = lamp_light(room, 0.9F);
  for (const std::uint32_t limit : {0U, 1U, 3U}) {
    const StopTest stop{.max_iterations = limit};
    const Solved s = solved(room, light, GetParam(), stop);
    EXPECT_FALSE(s.report.converged);
    EXPECT_EQ(s.report.iterations, limit);
    EXPECT_THAT(s.report.reason, HasSubstr("limit of"));
    expect_honest(room, light, s, stop);
  }
}

TEST_P(EveryMethod, AToleranceBeyondSinglePrecisionEndsHonestly) {
  const Room room = make_room(6, 3);
  const Light light = lamp_light(room, 0.9F);
  const StopTest stop{.tolerance = 1e-10};
  const Solved s = solved(room, light, GetParam(), stop);
  EXPECT_FALSE(s.report.converged);
  EXPECT_LT(s.report.iterations, 500U);
  EXPECT_THAT(s.report.reason, HasSubstr("single precision"));
  EXPECT_THAT(s.report.relative_residual, Each(Le(3e-7)));  // as far as an fp32 b can go, not just as far as one pass
  EXPECT_GT(s.report.passes, 1U);
  expect_honest(room, light, s, stop);
}

TEST_P(EveryMethod, AMirrorRoomHasNoSolutionAndSaysSo) {
  const Room room = make_room(4, 2);
  const std::size_t n = room.area.size();
  Light light{{std::vector<float>(n, 1.0F)},
              {std::vector<float>(n, 1.0F)}};  // closed, nothing absorbs: b grows for ever
  const Solved s = solved(room, light, GetParam(), {.max_iterations = 300});
  EXPECT_FALSE(s.report.converged);
  EXPECT_LE(s.report.iterations, 300U);
  expect_honest(room, light, s);
}

TEST(Solve, FixedIterationsOfJacobiAreTheBounces) {
  const Room room = make_room(5, 2);
  const Light light = lamp_light(room, 0.9F);
  for (const int bounces : {0, 1, 2, 7}) {
    const StopTest stop{.iterations = static_cast<std::uint32_t>(bounces)};
    const Solved s = solved(room, light, Method::jacobi, stop);
    EXPECT_EQ(s.report.iterations, static_cast<std::uint32_t>(bounces));
    EXPECT_EQ(s.report.products, static_cast<std::uint32_t>(bounces) + 1);  // the residual's
    const Doubles exact = reference_bounces(room.form_factors, light.reflectance, light.emittance, bounces);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(relative_to_maximum(s.b[c], exact[c]), 2e-6) << bounces;
    expect_honest(room, light, s, stop);
  }
}

TEST_P(EveryMethod, FixedIterationsAreDoneExactlyEvenAfterConvergence) {
  const Room room = make_room(5, 2);
  const Light light = lamp_light(room, 0.5F);
  const Solved s = solved(room, light, GetParam(), {.iterations = 60});
  EXPECT_EQ(s.report.iterations, 60U);
  EXPECT_TRUE(s.report.converged);
  expect_honest(room, light, s);
}

TEST(Solve, OneAndManyColumns) {
  const Room room = make_room(5, 2);
  const Light light = lamp_light(room, 0.85F);
  const Solved three = solved(room, light, Method::cg);
  Light many;
  for (int group = 0; group < 3; ++group) {
    many.reflectance.insert(many.reflectance.end(), light.reflectance.begin(), light.reflectance.end());
    many.emittance.insert(many.emittance.end(), light.emittance.begin(), light.emittance.end());
  }
  const Solved nine = solved(room, many, Method::cg);
  EXPECT_TRUE(nine.report.converged);
  for (std::size_t c = 0; c < 9; ++c) EXPECT_LT(relative_to_maximum(nine.b[c], three.b[c % 3]), 2e-6);
  const Solved one = solved(room, {{light.reflectance[2]}, {light.emittance[2]}}, Method::cg);
  EXPECT_LT(relative_to_maximum(one.b[0], three.b[2]), 2e-6);
}

/// A starting guess: the solution before a lamp was dimmed a little is worth products.
TEST_P(EveryMethod, TheLastSolutionIsAGoodStart) {
  const Room room = make_room(6, 3);
  Light light = lamp_light(room, 0.8F);
  const Solved before = solved(room, light, GetParam());
  for (auto& column : light.emittance) {
    for (float& e : column) e *= 0.999F;
  }
  const Solved cold = solved(room, light, GetParam());
  Scheduler scheduler(room.form_factors, openmp(), 3);
  Solved warm;
  Checkpoint start;
  start.b = before.b;
  warm.report =
      solve(scheduler, GetParam(), StopTest{}, room.area, light.reflectance, light.emittance, warm.b, nullptr, &start);
  expect_honest(room, light, warm);
  EXPECT_TRUE(warm.report.converged);
  EXPECT_LT(warm.report.products + 2, cold.report.products);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(relative_to_maximum(warm.b[c], cold.b[c]), 1e-5);
}

TEST_P(EveryMethod, OnePatch) {
  Room room;
  room.area = {2.0};
  room.form_factors = FormFactorMatrix(1);
  room.form_factors.row(0)[0] = 0.5F;  // sees itself and the sky
  const Solved s = solved(room, {{{0.5F}}, {{3.0F}}}, GetParam());
  EXPECT_TRUE(s.report.converged);
  EXPECT_NEAR(s.b[0][0], 4.0F, 1e-5F);
}

}  // namespace
}  // namespace interflect
