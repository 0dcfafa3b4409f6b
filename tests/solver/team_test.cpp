#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "interflect/solver/fallback.h"
#include "schedule/counting_device.h"
#include "schedule/failing_device.h"
#include "solver/lit_room.h"

// Devices that solve together, one of which fails at its k-th call, for every k of a small solve: the others end it,
// the result is right and the report says who was lost. All of them are OpenMP's under other names.

namespace interflect {
namespace {

using namespace test;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr std::uint64_t no_call = std::numeric_limits<std::uint64_t>::max();
constexpr double never = std::numeric_limits<double>::infinity();  // seconds

const LitRoom& scene() {
  static const LitRoom made(0.9F);
  return made;
}

bool right(const Columns& b, double bound = 5e-6) {
  return test::right(b, scene().solution, bound);
}

/// One solve by the devices `ids` together, of which "failing" does.
struct Attempt {
  std::shared_ptr<Fate> fate = std::make_shared<Fate>();
  Columns b{{7.0F}};
  FallbackReport result;
  std::optional<Error> error;
  Messages sink;

  Attempt(const std::vector<std::string>& ids, Method method, std::uint64_t fails_at, double interval,
          LastFails last = LastFails::throws, Fate::Way way = Fate::Way::lost) {
    fate->fails_at = fails_at;
    fate->way = way;
    Candidates candidates(
        ids,
        [&](const std::string& id) -> std::unique_ptr<Device> {
          if (id == "failing") return std::make_unique<FailingDevice>(fate);
          if (id == "absent") throw device_error(id, "open", "not there");
          const auto counts = std::make_shared<Counts>();
          counts->describe = [id](DeviceInfo& info) { info.id = id; };
          return std::make_unique<CountingDevice>(counts);
        },
        &sink, SplitOptions{.weights = {}, .said = [](std::size_t, std::uint64_t bytes, double) {
                              return static_cast<double>(bytes) * 1e-9;
                            }});
    const LitRoom& s = scene();
    try {
      result = solve_on(candidates, s.room.form_factors, method, {}, s.room.area, s.light.reflectance,
                        s.light.emittance, b, nullptr, interval, {}, last);
    } catch (const Error& thrown) {
      error = thrown;
    }
  }
};

class Team : public ::testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Method, Team, ::testing::Values(Method::cg, Method::bicgstab, Method::jacobi),
                         [](const auto& info) { return std::string(name(info.param)); });

TEST_P(Team, SolvesAsOneDeviceDoes) {
  const Attempt alone({"a"}, GetParam(), no_call, never), both({"a", "b"}, GetParam(), no_call, never);
  ASSERT_FALSE(both.error.has_value()) << both.error->what();
  EXPECT_EQ(both.b, alone.b);
  EXPECT_TRUE(right(both.b));
  EXPECT_EQ(both.result.report.products, alone.result.report.products);
  EXPECT_THAT(both.result.devices, ElementsAre("a", "b"));
  EXPECT_THAT(alone.result.shares, IsEmpty());
  ASSERT_EQ(both.result.shares.size(), 2U);
  EXPECT_NEAR(both.result.shares[0].share, 0.5, 0.1);
}

/// Beside the first: the solve does not even begin anew.
TEST_P(Team, AnyOtherDeviceMayBeLostAtAnyCall) {
  const Attempt whole({"a", "failing", "c"}, GetParam(), no_call, never);
  EXPECT_THAT(whole.result.devices, ElementsAre("a", "failing", "c"));
  ASSERT_GT(whole.fate->calls, 20U);
  for (std::uint64_t k = 0; k < whole.fate->calls; ++k) {
    SCOPED_TRACE(k);
    const Attempt run({"a", "failing", "c"}, GetParam(), k, never);
    ASSERT_FALSE(run.error.has_value()) << run.error->what();
    EXPECT_TRUE(run.result.report.converged);
    EXPECT_EQ(run.b, whole.b) << "rows are the same wherever they are computed";
    EXPECT_EQ(run.result.report.products, whole.result.report.products) << "none is counted twice";
    ASSERT_EQ(run.result.failures.size(), 1U);
    EXPECT_EQ(run.result.failures[0].device, "failing");
    EXPECT_THAT(run.sink.lines, ElementsAre(HasSubstr("lost (-4); going on with the others")));
    EXPECT_THAT(run.result.devices, Contains("a"));
    EXPECT_THAT(run.result.devices, Contains("c"));
    EXPECT_EQ(run.result.shares[1].share, 0.0);
    EXPECT_EQ(run.fate->live_buffers, 0);
    EXPECT_EQ(run.fate->live_kernels, 0);
  }
}

/// The first has the vectors: the others place F anew and go on from the last iterate.
TEST_P(Team, TheFirstDeviceMayBeLostAtAnyCall) {
  for (const double interval : {0.0, never}) {
    const Attempt whole({"failing", "b", "c"}, GetParam(), no_call, interval);
    bool handed_over = false;
    for (std::uint64_t k = 0; k < whole.fate->calls; ++k) {
      SCOPED_TRACE(k);
      const Attempt run({"failing", "b", "c"}, GetParam(), k, interval);
      ASSERT_FALSE(run.error.has_value()) << run.error->what();
      EXPECT_TRUE(run.result.report.converged);
      EXPECT_TRUE(right(run.b));
      ASSERT_EQ(run.result.failures.size(), 1U);
      EXPECT_EQ(run.result.failures[0].device, "failing");
      ASSERT_EQ(run.result.shares.size(), 2U);
      EXPECT_EQ(run.result.shares[0].device, "b");
      handed_over = handed_over || run.result.devices.size() == 3;
      EXPECT_EQ(run.fate->live_buffers, 0);
    }
    EXPECT_EQ(handed_over, interval == 0);
  }
}

TEST_P(Team, TheLastDeviceIsOneCleanErrorAndTheIterateIsKept) {
  const std::uint64_t calls = Attempt({"absent", "failing"}, GetParam(), no_call, 0).fate->calls;
  bool kept = false;
  for (std::uint64_t k = 0; k < calls; ++k) {
    SCOPED_TRACE(k);
    const Attempt thrown({"absent", "failing"}, GetParam(), k, 0);
    ASSERT_TRUE(thrown.error.has_value());
    EXPECT_EQ(thrown.error->kind(), ErrorKind::device);
    EXPECT_EQ(thrown.b, (Columns{{7.0F}}));
    const Attempt run({"absent", "failing"}, GetParam(), k, 0, LastFails::gives_up);
    ASSERT_EQ(run.result.lost.has_value(), !run.error.has_value());
    if (!run.result.lost) continue;  // lost before the first iteration was done
    kept = true;
    EXPECT_THAT(run.result.lost->what(), HasSubstr("lost (-4)"));
    EXPECT_FALSE(run.result.report.converged);
    EXPECT_THAT(run.result.report.reason, HasSubstr("the last device was lost after"));
    EXPECT_EQ(run.result.failures.size(), 2U);
    EXPECT_EQ(run.result.report.relative_residual.size(), scene().solution.size());
    ASSERT_EQ(run.b.size(), scene().solution.size());
    // Nearer to the solution than the emittance alone.
    const LitRoom& s = scene();
    EXPECT_LT(relative_to_maximum(run.b[0], s.solution[0]), relative_to_maximum(s.light.emittance[0], s.solution[0]));
  }
  EXPECT_TRUE(kept);
}

/// What is measured after the solve may lose the last device: the solution stays.
TEST(TeamAfter, TheLastDeviceLostBehindTheSolveCostsNoSolution) {
  const LitRoom& s = scene();
  for (const LastFails last : {LastFails::throws, LastFails::gives_up}) {
    Candidates one(open_device("openmp"));
    const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
      return std::make_unique<Scheduler>(s.room.form_factors, std::move(devices), 3);
    };
    const auto after = [](Scheduler&) { throw device_error("openmp", "download", "lost"); };
    Columns b;
    const auto run = [&] {
      return solve_on(one, place, Method::cg, {}, s.room.area, s.light.reflectance, s.light.emittance, b, nullptr,
                      never, after, last);
    };
    if (last == LastFails::throws) {
      EXPECT_THROW(static_cast<void>(run()), Error);
      continue;
    }
    const FallbackReport report = run();
    EXPECT_TRUE(report.lost.has_value());
    EXPECT_TRUE(report.report.converged);
    EXPECT_TRUE(right(b));
  }
}

/// The twin: a part that says nothing and does nothing is seen in the result.
TEST_P(Team, TwinAPartThatDoesNothingIsSeen) {
  const Attempt whole({"a", "failing"}, GetParam(), no_call, never);
  std::uint64_t first = 0;
  while (whole.fate->operations[first] != "launch matvec") ++first;
  const Attempt run({"a", "failing"}, GetParam(), first, never, LastFails::throws, Fate::Way::silent);
  ASSERT_FALSE(run.error.has_value());
  EXPECT_FALSE(right(run.b));
}

TEST(TeamOpens, WhoIsThere) {
  const Attempt run({"a", "absent", "c"}, Method::cg, no_call, never);
  EXPECT_TRUE(right(run.b));
  EXPECT_THAT(run.result.devices, ElementsAre("a", "c"));
  EXPECT_THAT(run.sink.lines, ElementsAre(HasSubstr("absent: open: not there; going on with the others")));
  const Attempt first({"absent", "c"}, Method::cg, no_call, never);
  EXPECT_TRUE(right(first.b));
  EXPECT_THAT(first.sink.lines, ElementsAre(HasSubstr("going on with c")));
  EXPECT_TRUE(Attempt({"absent"}, Method::cg, no_call, never).error.has_value());
}

}  // namespace
}  // namespace interflect
