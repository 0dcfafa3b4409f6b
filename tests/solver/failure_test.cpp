#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/solver/solver.h"
#include "interflect/solver/stopping.h"
#include "schedule/counting_device.h"
#include "solver/reference.h"
#include "solver/room.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::HasSubstr;

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

/// solve() on F with one column throws an Error of this kind whose message holds `part`.
void expect_refused(const Room& room, const Columns& rho, const Columns& e, std::span<const double> area,
                    const StopTest& stop, ErrorKind kind, const std::string& part) {
  Scheduler scheduler(room.form_factors, openmp(), 1);
  Columns b;
  try {
    static_cast<void>(solve(scheduler, Method::cg, stop, area, rho, e, b));
    FAIL() << "no error for " << part;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    EXPECT_THAT(error.what(), HasSubstr(part));
  }
}

TEST(SolveRefuses, ValuesThatMakeNoSense) {
  const Room room = make_room(2, 1);
  const std::size_t n = room.area.size();
  const std::vector<float> rho(n, 0.5F), e(n, 1.0F);
  const auto with = [](std::vector<float> column, std::size_t i, float value) {
    column[i] = value;
    return Columns{column};
  };
  for (const float bad : {nan, infinity, -infinity}) {
    expect_refused(room, {rho}, with(e, 17, bad), room.area, {}, ErrorKind::input, "emittance of patch 17, column 0");
  }
  for (const float bad : {nan, -0.1F, 1.01F, infinity}) {
    expect_refused(room, with(rho, 3, bad), {e}, room.area, {}, ErrorKind::input, "reflectance of patch 3, column 0");
  }
  for (const double bad : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    std::vector<double> area = room.area;
    area[5] = bad;
    expect_refused(room, {rho}, {e}, area, {}, ErrorKind::input, "area of patch 5");
  }
  for (const double bad : {-1e-6, std::nan(""), std::numeric_limits<double>::infinity()}) {
    expect_refused(room, {rho}, {e}, room.area, {.tolerance = bad}, ErrorKind::usage, "tolerance");
  }
}

TEST(SolveRefuses, ShapesThatDoNotMatch) {
  const Room room = make_room(2, 1);
  const std::size_t n = room.area.size();
  const std::vector<float> right(n, 0.5F), wrong(n - 1, 0.5F);
  expect_refused(room, {wrong}, {right}, room.area, {}, ErrorKind::usage, "reflectance");
  expect_refused(room, {right}, {wrong}, room.area, {}, ErrorKind::usage, "emittance");
  expect_refused(room, {right}, {right, right}, room.area, {}, ErrorKind::usage, "emittance");
  expect_refused(room, {right}, {right}, std::span(room.area).first(n - 1), {}, ErrorKind::usage, "areas");
}

/// Patch i sees nothing but patch i + 1: not reciprocal, so no scene, but a valid system with a known breakdown: from a
/// single lamp every new residual is at right angles to the first.
Room ring(std::uint32_t n) {
  Room room;
  room.area.assign(n, 1.0);
  room.form_factors = FormFactorMatrix(n);
  for (std::uint32_t i = 0; i < n; ++i) room.form_factors.row(i)[(i + 1) % n] = 1.0F;
  return room;
}

TEST(Breakdown, BiCgStabRestartsAndConverges) {
  const Room room = ring(12);
  Columns rho(2, std::vector<float>(12, 0.6F)), e(2, std::vector<float>(12));
  e[0][4] = 1.0F;                                                                          // breaks down
  for (std::size_t i = 0; i < 12; ++i) e[1][i] = 1.0F + 0.1F * static_cast<float>(i % 5);  // does not
  Scheduler scheduler(room.form_factors, openmp(), 2);
  Columns b;
  const SolveReport report = solve(scheduler, Method::bicgstab, {}, room.area, rho, e, b);
  EXPECT_TRUE(report.converged) << report.reason;
  EXPECT_GT(report.restarts, 0U);
  const Doubles exact = reference_solution(room.form_factors, rho, e);
  for (std::size_t c = 0; c < 2; ++c) EXPECT_LT(relative_to_maximum(b[c], exact[c]), 5e-6);
}

TEST(Breakdown, ARoomNeedsNoRestart) {
  const Room room = make_room(6, 3);
  const Light light = lamp_light(room, 0.9F);
  Scheduler scheduler(room.form_factors, openmp(), 3);
  Columns b;
  EXPECT_EQ(solve(scheduler, Method::bicgstab, {}, room.area, light.reflectance, light.emittance, b).restarts, 0U);
}

TEST(Breakdown, CgWithoutReciprocityEndsHonestly) {
  const Room room = ring(12);
  Columns rho(1, std::vector<float>(12, 0.9F)), e(1, std::vector<float>(12));
  e[0][4] = 1.0F;
  Scheduler scheduler(room.form_factors, openmp(), 1);
  Columns b;
  const SolveReport report = solve(scheduler, Method::cg, {}, room.area, rho, e, b);
  const double residual = reference_residual(room.form_factors, rho[0], e[0], b[0]);
  EXPECT_NEAR(report.relative_residual[0], residual, 1e-6 * residual);
  EXPECT_EQ(report.converged, residual <= 1e-6);
  for (const float value : b[0]) EXPECT_TRUE(std::isfinite(value));
}

TEST(Breakdown, AMatrixWithNaNEndsTheLoopAtOnce) {
  Room room = make_room(4, 2);
  room.form_factors.row(7)[9] = nan;
  const Light light = lamp_light(room, 0.9F);
  for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
    Scheduler scheduler(room.form_factors, openmp(), 3);
    Columns b;
    const SolveReport report = solve(scheduler, method, {}, room.area, light.reflectance, light.emittance, b);
    EXPECT_FALSE(report.converged);
    EXPECT_LE(report.iterations, 1U);
    EXPECT_THAT(report.reason, HasSubstr("no longer finite"));
    for (const float value : b[0]) ASSERT_TRUE(std::isfinite(value));
  }
}

TEST(Breakdown, AnOverflowingResultStaysFinite) {
  const Room room = make_room(4, 2);
  const std::size_t n = room.area.size();
  const Columns rho(1, std::vector<float>(n, 0.9F)), e(1, std::vector<float>(n, 1e38F));  // b = 1e39
  for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
    Scheduler scheduler(room.form_factors, openmp(), 1);
    Columns b;
    const SolveReport report = solve(scheduler, method, {}, room.area, rho, e, b);
    EXPECT_FALSE(report.converged);
    for (const float value : b[0]) ASSERT_TRUE(std::isfinite(value));
  }
}

TEST(Stopping, ReachedStalledAndNotFinite) {
  const std::vector<float> target{1e-4F, 1e-2F};
  Stopping stopping(target, 3);
  EXPECT_EQ(stopping.look(std::vector{1.0F, 1.0F}), Verdict::go_on);
  EXPECT_EQ(stopping.look(std::vector{0.5F, 1e-3F}), Verdict::go_on);
  EXPECT_EQ(stopping.look(std::vector{0.5F, 1e-3F}), Verdict::go_on);
  EXPECT_EQ(stopping.look(std::vector{0.49F, 1e-3F}), Verdict::go_on);
  EXPECT_EQ(stopping.look(std::vector{0.48F, 1e-3F}), Verdict::stalled);
  EXPECT_EQ(stopping.look(std::vector{0.1F, 1e-3F}), Verdict::go_on);
  EXPECT_EQ(stopping.look(std::vector{1e-4F, 1e-3F}), Verdict::reached);
  EXPECT_EQ(stopping.look(std::vector{nan, 1e-3F}), Verdict::not_finite);
  EXPECT_EQ(stopping.look(std::vector{1e-5F, infinity}), Verdict::not_finite);
}

TEST(Stopping, TargetsAndProgress) {
  EXPECT_NEAR(pass_target(1e-6, 1.0), 0.81e-12F, 1e-17F);
  EXPECT_NEAR(pass_target(1e-6, 1e-5), 0.0081F, 1e-6F);
  EXPECT_NEAR(pass_target(1e-12, 1.0), 9e-14F, 1e-18F);  // no pass is asked for the impossible
  EXPECT_DOUBLE_EQ(progress_made(1e-6, 1.0), 0.0);
  EXPECT_DOUBLE_EQ(progress_made(1e-6, 1e-3), 0.5);
  EXPECT_DOUBLE_EQ(progress_made(1e-6, 1e-7), 1.0);
  EXPECT_DOUBLE_EQ(progress_made(0.0, 1e-7), 0.0);
}

}  // namespace
}  // namespace interflect
