#include "interflect/solver/fallback.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "schedule/counting_device.h"
#include "schedule/failing_device.h"
#include "solver/lit_room.h"

// A device that fails at its k-th call, for every k of a small solve: alone it ends in one clean Error, with another
// device behind it in the right result and a report that says so. Nothing leaks and nothing wrong comes out.

namespace interflect {
namespace {

using namespace test;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double never = std::numeric_limits<double>::infinity();  // seconds
constexpr std::uint64_t no_call = std::numeric_limits<std::uint64_t>::max();

const LitRoom& scene() {
  static const LitRoom made(0.9F);
  return made;
}

/// One solve on a failing device and, with `behind`, a good one.
struct Attempt {
  std::shared_ptr<Fate> fate = std::make_shared<Fate>();
  std::shared_ptr<Counts> good = std::make_shared<Counts>();
  Columns b{{7.0F}};
  FallbackReport result;
  std::optional<Error> error;
  Messages sink;

  Attempt(Method method, const StopTest& stop, std::uint64_t fails_at, bool behind, double interval,
          Fate::Way way = Fate::Way::lost) {
    fate->fails_at = fails_at;
    fate->way = way;
    std::vector<std::string> ids{"failing"};
    if (behind) ids.emplace_back("openmp");
    Candidates candidates(
        ids,
        [&](const std::string& id) -> std::unique_ptr<Device> {
          if (id == "failing") return std::make_unique<FailingDevice>(fate);
          return std::make_unique<CountingDevice>(good);
        },
        &sink);
    const LitRoom& s = scene();
    try {
      result = solve_on(candidates, s.room.form_factors, method, stop, s.room.area, s.light.reflectance,
                        s.light.emittance, b, nullptr, interval);
    } catch (const Error& thrown) {
      error = thrown;
    }
  }
};

class Fallback : public ::testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Method, Fallback, ::testing::Values(Method::cg, Method::bicgstab, Method::jacobi),
                         [](const auto& info) { return std::string(name(info.param)); });

TEST_P(Fallback, AloneEveryFailureIsOneCleanError) {
  const std::uint64_t calls = Attempt(GetParam(), {}, no_call, false, 0).fate->calls;
  ASSERT_GT(calls, 30U);
  for (std::uint64_t k = 0; k < calls; ++k) {
    const Attempt run(GetParam(), {}, k, false, 0);
    ASSERT_TRUE(run.error.has_value()) << k;
    EXPECT_EQ(run.error->kind(), ErrorKind::device);
    EXPECT_EQ(run.error->what(), "failing: " + run.fate->operations.back() + ": lost (-4)");
    EXPECT_EQ(run.b, (Columns{{7.0F}})) << k;  // untouched
    EXPECT_EQ(run.fate->live_buffers, 0) << k;
    EXPECT_EQ(run.fate->live_kernels, 0) << k;
    EXPECT_THAT(run.sink.lines, IsEmpty());
  }
}

TEST_P(Fallback, TheNextDeviceEndsEverySolveThatFails) {
  for (const double interval : {0.0, never}) {
    const Attempt whole(GetParam(), {}, no_call, true, interval);
    EXPECT_THAT(whole.result.devices, ElementsAre("failing"));
    EXPECT_THAT(whole.result.failures, IsEmpty());
    EXPECT_EQ(whole.good->allocations, 0U);
    bool handed_over = false;
    for (std::uint64_t k = 0; k < whole.fate->calls; ++k) {
      SCOPED_TRACE(k);
      const Attempt run(GetParam(), {}, k, true, interval);
      ASSERT_FALSE(run.error.has_value()) << run.error->what();
      const SolveReport& report = run.result.report;
      EXPECT_TRUE(report.converged) << report.reason;
      EXPECT_TRUE(right(run.b, scene().solution, 5e-6));
      ASSERT_EQ(run.result.failures.size(), 1U);
      EXPECT_EQ(run.result.failures[0].device, "failing");
      EXPECT_EQ(run.result.failures[0].reason, "failing: " + run.fate->operations.back() + ": lost (-4)");
      EXPECT_THAT(run.sink.lines, ElementsAre(HasSubstr("lost (-4); going on with openmp")));
      EXPECT_EQ(run.fate->live_buffers, 0);
      EXPECT_EQ(run.fate->live_kernels, 0);
      EXPECT_EQ(run.result.devices.back(), "openmp");
      // Counted by the devices, and one product in double for each pass and for the b that was handed over.
      const bool went_on = run.result.devices.size() == 2;
      EXPECT_EQ(report.products,
                run.fate->launches["matvec"] + run.good->launches["matvec"] + report.passes + (went_on ? 1 : 0));
      handed_over = handed_over || went_on;
      // What Jacobi has is worth as much on the next device: a bounce or two are done twice at most.
      if (GetParam() == Method::jacobi && interval == 0) {
        EXPECT_LE(report.iterations, whole.result.report.iterations + 3);
      }
    }
    EXPECT_EQ(handed_over, interval == 0) << "one pass: without checkpoints there is nothing to hand over";
  }
}

TEST_P(Fallback, WhatAFinishedPassAcceptedIsKept) {
  const StopTest strict{.tolerance = 1e-10};  // more than one pass
  const Attempt whole(GetParam(), strict, no_call, true, never);
  ASSERT_GT(whole.result.report.passes, 1U);
  const Attempt run(GetParam(), strict, whole.fate->calls - 1, true, never);
  ASSERT_FALSE(run.error.has_value());
  EXPECT_THAT(run.result.devices, ElementsAre("failing", "openmp"));
  EXPECT_EQ(run.result.report.converged, whole.result.report.converged);
  EXPECT_LT(run.good->launches["matvec"], run.fate->launches["matvec"]);
  EXPECT_TRUE(right(run.b, scene().solution, 5e-6));
}

TEST(FallbackJacobi, AFixedNumberOfBouncesStaysThatNumber) {
  for (const std::uint32_t bounces : {1U, 6U}) {
    const LitRoom& s = scene();
    const Doubles exact =
        reference_bounces(s.room.form_factors, s.light.reflectance, s.light.emittance, static_cast<int>(bounces));
    const StopTest stop{.iterations = bounces};
    const std::uint64_t calls = Attempt(Method::jacobi, stop, no_call, true, 0).fate->calls;
    for (std::uint64_t k = 0; k < calls; ++k) {
      const Attempt run(Method::jacobi, stop, k, true, 0);
      ASSERT_FALSE(run.error.has_value());
      EXPECT_TRUE(right(run.b, exact, 2e-6)) << "call " << k << " of " << bounces << " bounces";
      EXPECT_GE(run.result.report.iterations, bounces);
    }
  }
}

// The twins: the tests above would see a device that fails without a word.

TEST(FallbackTwin, OneSkippedLaunchIsAWrongNumberOfBounces) {
  const LitRoom& s = scene();
  const StopTest stop{.iterations = 6};
  const Doubles exact = reference_bounces(s.room.form_factors, s.light.reflectance, s.light.emittance, 6);
  const Attempt whole(Method::jacobi, stop, no_call, false, never);
  ASSERT_TRUE(right(whole.b, exact, 2e-6));
  int launches = 0;
  for (std::uint64_t k = 0; k < whole.fate->calls; ++k) {
    if (!whole.fate->operations[k].starts_with("launch")) continue;
    const Attempt run(Method::jacobi, stop, k, false, never, Fate::Way::skips);
    ASSERT_FALSE(run.error.has_value());
    EXPECT_FALSE(right(run.b, exact, 2e-6)) << k << " " << whole.fate->operations[k];
    ++launches;
  }
  EXPECT_EQ(launches, 12);
}

TEST_P(Fallback, TwinADeviceThatDiesSilentlyDoesNotConverge) {
  const Attempt whole(GetParam(), {}, no_call, false, never);
  for (std::uint64_t k = 0; k < whole.fate->calls; ++k) {
    if (whole.fate->operations[k] != "launch matvec") continue;
    const Attempt run(GetParam(), {.max_iterations = 60}, k, false, never, Fate::Way::silent);
    ASSERT_FALSE(run.error.has_value());
    const bool good = right(run.b, scene().solution, 5e-6);
    if (run.result.report.converged) {
      EXPECT_TRUE(good) << k;  // what is behind the last iteration changes nothing
    }
    if (k < whole.fate->calls / 2) {
      EXPECT_FALSE(good) << k;
    }
  }
}

// Which failures another device can help with.

FallbackReport solved_on(Candidates& candidates, const Columns& emittance, Columns& b) {
  const LitRoom& s = scene();
  return solve_on(candidates, s.room.form_factors, Method::cg, {}, s.room.area, s.light.reflectance, emittance, b);
}

TEST(Candidates, ALimitOfOneDeviceIsNoneOfTheNext) {
  const auto small = std::make_shared<Counts>();
  small->may_share = false;
  small->describe = [](DeviceInfo& info) {
    info.id = "small";
    info.memory_bytes = 1000;
  };
  const auto open = [&](const std::string& id) -> std::unique_ptr<Device> {
    if (id == "small") return std::make_unique<CountingDevice>(small);
    if (id == "absent") throw device_error("absent", "open", "not there");
    return open_device(id);
  };
  Candidates all({"absent", "small", "openmp"}, open);
  all.open();
  EXPECT_EQ(all.id(), "small");
  Columns b;
  const FallbackReport result = solved_on(all, scene().light.emittance, b);
  EXPECT_THAT(result.devices, ElementsAre("openmp"));
  ASSERT_EQ(result.failures.size(), 2U);
  EXPECT_EQ(result.failures[0].reason, "absent: open: not there");
  EXPECT_THAT(result.failures[1].reason, HasSubstr("may be used"));
  EXPECT_TRUE(right(b, scene().solution, 5e-6));

  Candidates none({"absent", "small"}, open);
  try {
    static_cast<void>(solved_on(none, scene().light.emittance, b));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::limit);
    EXPECT_THAT(error.what(), HasSubstr("small: "));
  }
  Candidates absent({"absent"}, open);
  EXPECT_THROW(absent.open(), Error);
  EXPECT_THROW(Candidates({}, open), Error);
}

TEST(Candidates, AMistakeInTheInputIsNotTriedAgain) {
  int opened = 0;
  Candidates candidates({"a", "b"}, [&](const std::string&) {
    ++opened;
    return open_device("openmp");
  });
  Columns bad = scene().light.emittance, b;
  bad[0][3] = std::numeric_limits<float>::quiet_NaN();
  try {
    static_cast<void>(solved_on(candidates, bad, b));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
  }
  EXPECT_EQ(opened, 1);
}

TEST(Candidates, ADeviceThatIsOpenAlreadyIsUsedOnce) {
  Candidates one(open_device("openmp"));
  Columns b;
  EXPECT_THAT(solved_on(one, scene().light.emittance, b).devices, ElementsAre("openmp"));
  EXPECT_THROW(static_cast<void>(one.take()), Error);
}

// The checkpoint itself.

TEST(Checkpoint, AColumnThatIsWorseThanNothingIsDropped) {
  const LitRoom& s = scene();
  Checkpoint checkpoint;
  checkpoint.b = s.light.emittance;
  for (float& value : checkpoint.b[0]) value = 1e6F;
  checkpoint.b[1][0] = std::numeric_limits<float>::quiet_NaN();
  checkpoint.kept_iterations = checkpoint.iterations = 4;
  Scheduler scheduler(s.room.form_factors, openmp(), 3);
  Columns b;
  const SolveReport report =
      solve(scheduler, Method::cg, {}, s.room.area, s.light.reflectance, s.light.emittance, b, nullptr, &checkpoint);
  EXPECT_TRUE(report.converged);
  EXPECT_GT(report.iterations, 4U);
  EXPECT_TRUE(right(b, s.solution, 5e-6));
}

TEST(Checkpoint, TheLimitOfIterationsCountsWhatTheIterateIsMadeOf) {
  const LitRoom& s = scene();
  for (const std::uint32_t kept : {3U, 5U, 9U}) {
    Checkpoint checkpoint;
    checkpoint.b = s.light.emittance;
    checkpoint.kept_iterations = kept;
    checkpoint.iterations = 20;  // fifteen and more were lost
    Scheduler scheduler(s.room.form_factors, openmp(), 3);
    Columns b;
    const SolveReport report = solve(scheduler, Method::bicgstab, {.max_iterations = 5}, s.room.area,
                                     s.light.reflectance, s.light.emittance, b, nullptr, &checkpoint);
    EXPECT_FALSE(report.converged);
    EXPECT_EQ(report.iterations, kept == 3 ? 22U : 20U);
    EXPECT_THAT(report.reason, HasSubstr("limit of"));
    EXPECT_EQ(b == s.light.emittance, kept != 3);
  }
}

/// What is measured after a solve may lose the device as well: then the next one solves, and is measured.
TEST(Fallback, ADeviceLostAfterTheSolveIsFollowedByTheNext) {
  const LitRoom& s = scene();
  Messages sink;
  const auto open = [](const std::string&) -> std::unique_ptr<Device> {
    return std::make_unique<CountingDevice>(std::make_shared<Counts>());
  };
  const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
    return std::make_unique<Scheduler>(s.room.form_factors, std::move(devices), 3);
  };
  int lost = 1, calls = 0;
  const auto after = [&](Scheduler&) {
    ++calls;
    if (lost-- > 0) throw device_error("first", "download", "lost");
  };
  const auto run = [&](const std::vector<std::string>& ids, Columns& b) {
    Candidates candidates(ids, open, &sink);
    return solve_on(candidates, place, Method::cg, {}, s.room.area, s.light.reflectance, s.light.emittance, b, nullptr,
                    1.0, after);
  };
  Columns b;
  const FallbackReport report = run({"first", "second"}, b);
  EXPECT_EQ(calls, 2);
  EXPECT_TRUE(report.report.converged);
  EXPECT_EQ(report.devices.back(), "second");
  ASSERT_EQ(report.failures.size(), 1U);
  EXPECT_THAT(report.failures.front().reason, HasSubstr("lost"));
  EXPECT_TRUE(right(b, s.solution, 1e-5));
  lost = 1;
  EXPECT_THROW(static_cast<void>(run({"first"}, b)), Error);
}

}  // namespace
}  // namespace interflect
