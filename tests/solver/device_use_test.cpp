#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/solver/solver.h"
#include "schedule/counting_device.h"
#include "solver/room.h"

// How a solve uses its device: what it counts, when it waits, and that nothing changes the bits.

namespace interflect {
namespace {

using namespace test;

struct Outcome {
  SolveReport report;
  Columns b;
  std::shared_ptr<Counts> counts = std::make_shared<Counts>();
  std::uint64_t panels = 0;
};

Outcome outcome_of(Method method, const StopTest& stop = {}, std::uint64_t panel_bytes = std::uint64_t{1} << 30,
                   bool share = true) {
  static const Room room = make_room(6, 3);
  const FormFactorMatrix form_factors = repanelled(room.form_factors, panel_bytes);
  const Light light = lamp_light(room, 0.9F);
  Outcome r;
  r.counts->may_share = share;
  Scheduler scheduler(form_factors, counting(r.counts), 3);
  r.report = solve(scheduler, method, stop, room.area, light.reflectance, light.emittance, r.b);
  r.panels = form_factors.panels().size();
  return r;
}

class DeviceUse : public ::testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Method, DeviceUse, ::testing::Values(Method::cg, Method::bicgstab, Method::jacobi),
                         [](const auto& info) { return std::string(name(info.param)); });

TEST_P(DeviceUse, ReportsTheProductsThatWereMade) {
  for (const double tolerance : {1e-6, 1e-10}) {  // one pass; several
    const Outcome r = outcome_of(GetParam(), {.tolerance = tolerance}, 100'000);
    ASSERT_GT(r.panels, 3U);
    EXPECT_EQ(r.counts->launches["matvec"] % r.panels, 0U);
    // the device's, and one in double on the host for each pass
    EXPECT_EQ(r.report.products, r.counts->launches["matvec"] / r.panels + r.report.passes);
  }
}

TEST_P(DeviceUse, CountsItsIterations) {
  const Outcome r = outcome_of(GetParam());
  ASSERT_EQ(r.report.passes, 1U);
  const char* step = GetParam() == Method::cg ? "cg_step" : GetParam() == Method::jacobi ? "bounce" : "bicgstab_step";
  const std::uint64_t start = GetParam() == Method::bicgstab ? 1 : 0;  // z = p = r
  EXPECT_EQ(r.report.iterations, r.counts->launches[step] - start);
}

TEST_P(DeviceUse, AllocatesNothingInTheLoopAndWaitsOncePerIteration) {
  const Outcome few = outcome_of(GetParam(), {.iterations = 3});
  const Outcome many = outcome_of(GetParam(), {.iterations = 13});
  EXPECT_EQ(few.counts->allocations, many.counts->allocations);
  EXPECT_EQ(few.counts->uploads, many.counts->uploads);
  EXPECT_EQ(few.counts->waits, many.counts->waits);
  EXPECT_EQ(many.counts->downloads - few.counts->downloads, 10U);  // one residual check each
  EXPECT_EQ(many.counts->allocations_at_download.front(), many.counts->allocations);
}

TEST_P(DeviceUse, SameBitsOnEveryRunWithAnyThreadsAndPanels) {
  const int before = ::omp_get_max_threads();
  const Outcome first = outcome_of(GetParam());
  EXPECT_EQ(outcome_of(GetParam()).b, first.b);
  for (const int threads : {1, 2, 3, 5}) {
    ::omp_set_num_threads(threads);
    EXPECT_EQ(outcome_of(GetParam()).b, first.b) << threads << " threads";
  }
  ::omp_set_num_threads(before);
  for (const std::uint64_t bytes : {1ULL, 30'000ULL}) {  // 1: a row each
    EXPECT_EQ(outcome_of(GetParam(), {}, bytes).b, first.b) << bytes << " bytes";
  }
  EXPECT_EQ(outcome_of(GetParam(), {}, 100'000, false).b, first.b) << "uploaded instead of shared";
}

TEST_P(DeviceUse, SameBitsWhenVectorsTakeSeveralGroups) {
  const Room room = sphere(1100);  // two blocks and nine columns: 18 work items
  const std::size_t n = room.area.size();
  Light light{Columns(9, std::vector<float>(n, 0.8F)), Columns(9, std::vector<float>(n, 0.0F))};
  for (std::size_t c = 0; c < 9; ++c) {
    for (std::size_t i = 0; i < n; ++i) light.emittance[c][i] = static_cast<float>((i * (c + 3)) % 17);
  }
  const int before = ::omp_get_max_threads();
  Columns first;
  for (const int threads : {1, 2, 4}) {
    ::omp_set_num_threads(threads);
    Scheduler scheduler(room.form_factors, openmp(), 9);
    Columns b;
    EXPECT_TRUE(solve(scheduler, GetParam(), {}, room.area, light.reflectance, light.emittance, b).converged);
    if (first.empty()) first = b;
    EXPECT_EQ(b, first) << threads << " threads";
  }
  ::omp_set_num_threads(before);
}

TEST_P(DeviceUse, APanelLimitFromTheEnvironmentChangesNoBit) {
  const Outcome first = outcome_of(GetParam());
  ASSERT_EQ(::setenv("INTERFLECT_MAX_PANEL_BYTES", "30000", 1), 0);
  const Outcome panels = outcome_of(GetParam(), {}, FormFactorMatrix::default_panel_bytes());
  ASSERT_EQ(::unsetenv("INTERFLECT_MAX_PANEL_BYTES"), 0);
  EXPECT_GT(panels.panels, 10U);
  EXPECT_EQ(panels.b, first.b);
}

TEST_P(DeviceUse, AFailingDeviceIsAnErrorWhateverTheLaunch) {
  const Outcome whole = outcome_of(GetParam(), {.iterations = 3});
  const std::size_t launches = whole.counts->labels.size();
  ASSERT_GT(launches, 3U);
  const Room room = make_room(3, 2);
  const Light light = lamp_light(room, 0.9F);
  for (std::size_t k = 0; k < launches; ++k) {
    const auto counts = std::make_shared<Counts>();
    counts->before_launch = [&, left = k](const std::string& kernel) mutable {
      if (left-- == 0) throw device_error("openmp", "launch " + kernel, "lost");
    };
    Scheduler scheduler(room.form_factors, counting(counts), 3);
    Columns b{{1.0F}};
    EXPECT_THROW(static_cast<void>(
                     solve(scheduler, GetParam(), {.iterations = 3}, room.area, light.reflectance, light.emittance, b)),
                 Error);
    EXPECT_EQ(b, (Columns{{1.0F}}));  // untouched
  }
}

class RecordingSink final : public ProgressSink {
 public:
  void begin(std::string_view /*stage*/, std::uint64_t total) override { total_ = total; }
  void advance(std::uint64_t steps) override { done_ += steps; }
  void end() override { ended_ = true; }
  std::uint64_t total_ = 0, done_ = 0;
  bool ended_ = false;
};

TEST_P(DeviceUse, ShowsProgressToTheEnd) {
  const Room room = make_room(5, 2);
  const Light light = lamp_light(room, 0.9F);
  Scheduler scheduler(room.form_factors, openmp(), 3);
  Columns b;
  RecordingSink sink;
  static_cast<void>(solve(scheduler, GetParam(), {}, room.area, light.reflectance, light.emittance, b, &sink));
  EXPECT_EQ(sink.total_, 100U);
  EXPECT_GE(sink.done_, 90U);
  EXPECT_LE(sink.done_, 100U);
  EXPECT_TRUE(sink.ended_);
}

/// Wants no more after so many iterations.
class ImpatientSink final : public ProgressSink {
 public:
  explicit ImpatientSink(std::uint32_t most) : most_(most) {}
  void iteration(std::uint32_t number, double residual) override {
    EXPECT_EQ(number, last_ + 1);
    last_ = number;
    residual_ = residual;
  }
  bool interrupted() override { return last_ >= most_; }
  std::uint32_t most_, last_ = 0;
  double residual_ = 0;
};

TEST_P(DeviceUse, AnInterruptedSolveGivesTheBestSoFar) {
  const Room room = make_room(5, 2);
  const Light light = lamp_light(room, 0.9F);
  Scheduler scheduler(room.form_factors, openmp(), 3);
  StopTest stop;
  const auto solved = [&](std::uint32_t most, Columns& b) {
    ImpatientSink sink(most);
    const SolveReport report =
        solve(scheduler, GetParam(), stop, room.area, light.reflectance, light.emittance, b, &sink);
    const double worst = *std::max_element(report.relative_residual.begin(), report.relative_residual.end());
    // At least as good as what was shown; Jacobi's last bounce is in b, but not yet in what it shows.
    EXPECT_TRUE(!report.interrupted || worst <= 1.001 * sink.residual_ + 1e-6) << worst << " " << sink.residual_;
    EXPECT_TRUE(!report.interrupted || worst >= 0.3 * sink.residual_) << worst << " " << sink.residual_;
    return report;
  };
  for (const auto iterations : {std::optional<std::uint32_t>{}, std::optional<std::uint32_t>{1000000}}) {
    stop.iterations = iterations;
    Columns b;
    const SolveReport report = solved(2, b);
    EXPECT_TRUE(report.interrupted);
    EXPECT_FALSE(report.converged);
    EXPECT_EQ(report.iterations, 2U);
    EXPECT_NE(report.reason.find("interrupted after 2 iterations"), std::string::npos) << report.reason;
    for (const auto& column : b) {
      for (const float value : column) EXPECT_TRUE(std::isfinite(value));
    }
  }
  // Also where the tolerance has been reached: the report says why it ended.
  const double tolerance = std::exchange(stop.tolerance, 0.9);
  Columns near;
  const SolveReport enough = solved(2, near);  // of the million that were asked for
  EXPECT_TRUE(enough.interrupted && enough.converged);
  EXPECT_NE(enough.reason.find("interrupted after 2 iterations"), std::string::npos) << enough.reason;
  stop.tolerance = tolerance;
  stop.iterations.reset();
  Columns b;
  const SolveReport whole = solved(1000000, b);  // nobody interrupts
  EXPECT_TRUE(whole.converged);
  EXPECT_FALSE(whole.interrupted);
  EXPECT_EQ(whole.reason, "");
}

}  // namespace
}  // namespace interflect
