// solve --light-groups: the report, the same light, and what is refused.
#include "lights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

struct Solved {
  Outcome outcome;
  json report;
  std::vector<float> radiosity;
};

Solved solve(const std::vector<std::string>& more) {
  const Folder folder;
  std::vector<std::string> arguments{"solve",    scene_file("room-1312.obj"), "--divide", "1",
                                     "--report", folder.file("report.json"),  "-o",       folder.file("b.npy")};
  arguments.insert(arguments.end(), more.begin(), more.end());
  Solved solved{run_program(arguments), {}, {}};
  EXPECT_EQ(solved.outcome.status, 0) << solved.outcome.err;
  solved.report = json::parse(content_of(folder.file("report.json")));
  const std::string npy = content_of(folder.file("b.npy"));
  solved.radiosity.resize(std::size_t{3} * 1312);
  std::memcpy(solved.radiosity.data(), npy.data() + npy.size() - solved.radiosity.size() * sizeof(float),
              solved.radiosity.size() * sizeof(float));
  return solved;
}

double difference(const std::vector<float>& a, const std::vector<float>& b) {
  double off = 0, largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i]));
    off = d <= off ? off : d;
    largest = std::max(largest, static_cast<double>(b[i]));
  }
  return off / largest;
}

TEST(SolveLightGroups, AreReportedAndGiveTheSameLight) {
  const Folder folder;
  const Solved all = solve({"--form-factors", folder.file("f.iff")});
  EXPECT_TRUE(all.report["light_groups"].is_null());
  const Solved apart = solve({"--form-factors", folder.file("f.iff"), "--light-groups", "object"});
  EXPECT_LT(difference(apart.radiosity, all.radiosity), 1e-5);
  const json& groups = apart.report["light_groups"];
  ASSERT_EQ(groups.size(), 3U);
  EXPECT_EQ(groups[0]["name"], "ceiling_lamp");
  EXPECT_EQ(groups[1]["name"], "floor_lamp");
  EXPECT_EQ(groups[2]["name"], "window");
  double emitted = 0, worst = 0;
  for (const json& group : groups) {
    for (const double e : group["emitted"]) emitted += e;
    ASSERT_EQ(group["relative_residual"].size(), 3U);
    for (const double r : group["relative_residual"]) {
      EXPECT_GT(r, 0.0);
      worst = std::max(worst, r);
    }
  }
  EXPECT_LE(worst, 1e-6);
  EXPECT_EQ(apart.report["relative_residual"].size(), 3U);
  EXPECT_EQ(std::max({double(apart.report["relative_residual"][0]), double(apart.report["relative_residual"][1]),
                      double(apart.report["relative_residual"][2])}),
            worst);
  EXPECT_NEAR(emitted, apart.report["energy"]["emitted"], 1e-9 * emitted);
  EXPECT_LT(apart.report["energy"]["balance_error"], 1e-5);
  EXPECT_THAT(apart.outcome.out, AllOf(HasSubstr("light groups   ceiling_lamp: 56 patches, emitted 11.3928, residual"),
                                       HasSubstr("of the worst light group")));
  // Panels from the file, and 16 bits, in the same products.
  const Solved streamed =
      solve({"--form-factors", folder.file("f.iff"), "--memory", "3M", "--light-groups", "warm=*lamp"});
  EXPECT_FALSE(streamed.report["storage"]["streamed"].is_null());
  EXPECT_LT(difference(streamed.radiosity, all.radiosity), 2e-5);
  ASSERT_EQ(streamed.report["light_groups"].size(), 2U);
  EXPECT_EQ(streamed.report["light_groups"][1]["name"], "other lights");
  const Solved packed =
      solve({"--form-factors", folder.file("f.iff"), "--storage", "sym16", "--light-groups", "material"});
  EXPECT_EQ(packed.report["light_groups"].size(), 4U);
  EXPECT_LT(difference(packed.radiosity, all.radiosity), 1e-4);
  EXPECT_LT(packed.report["storage"]["rounding_error"], 1e-4);
}

TEST(SolveLightGroups, TheWorstResidualIsWhatIsNoNumber) {
  const double none = std::nan("");
  const auto worst = cli::worst_of_groups({none, 1e-7, 3e-7, 1e-6, none, 2e-7});
  ASSERT_EQ(worst.size(), 3U);
  EXPECT_TRUE(std::isnan(worst[0]));  // also where a number follows
  EXPECT_TRUE(std::isnan(worst[1]));
  EXPECT_EQ(worst[2], 3e-7);
}

TEST(SolveLightGroups, AWrongListIsAUsageErrorBeforeTheWork) {
  const Folder folder;
  const Outcome outcome = run_program(
      {"solve", scene_file("cornell-box.obj"), "--light-groups", "lamp", "-o", folder.file("b.csv"), "--quiet"});
  EXPECT_EQ(outcome.status, 2);
  ASSERT_EQ(outcome.error_lines().size(), 1U);
  EXPECT_THAT(outcome.error_lines()[0],
              AllOf(HasSubstr("no emitter is called 'lamp'"), HasSubstr("the emitters are light")));
  EXPECT_TRUE(folder.names().empty());
}

}  // namespace
}  // namespace interflect::test
