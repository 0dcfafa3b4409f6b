// solve --storage: what is reported, what is the same, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

struct Solved {
  Outcome outcome;
  json report;
};

Solved solve(const std::string& scene, const std::vector<std::string>& more) {
  const Folder folder;
  std::vector<std::string> arguments{"solve", scene, "--patches", "1200", "--report", folder.file("report.json")};
  arguments.insert(arguments.end(), more.begin(), more.end());
  Solved solved{run_program(arguments), {}};
  EXPECT_EQ(solved.outcome.status, 0) << solved.outcome.err;
  solved.report = json::parse(content_of(folder.file("report.json")));
  return solved;
}

TEST(SolveStorage, EveryFormatIsReportedWithItsBytesAndItsError) {
  const std::string scene = scene_file("cornell-box.obj");
  const json dense = solve(scene, {"--storage", "dense32"}).report;
  EXPECT_EQ(dense["storage"]["format"], "dense32");
  EXPECT_TRUE(dense["storage"]["rounding_error"].is_null());
  double bytes = dense["storage"]["bytes"];
  for (const std::string format : {"dense16", "tiled16", "sym16"}) {
    const Solved solved = solve(scene, {"--storage", format});
    const json& storage = solved.report["storage"];
    EXPECT_EQ(storage["format"], format);
    EXPECT_LT(storage["bytes"], 0.95 * bytes) << format << " is smaller than what comes before it";
    bytes = storage["bytes"];
    EXPECT_NEAR(storage["nonzero_fraction"], dense["storage"]["nonzero_fraction"], 1e-3);
    EXPECT_GT(storage["rounding_error"], 0.0);
    EXPECT_LT(storage["rounding_error"], 1e-4);
    EXPECT_TRUE(solved.report["converged"]);
    EXPECT_THAT(solved.outcome.out, HasSubstr("storage        " + format));
    EXPECT_THAT(solved.outcome.out, HasSubstr("its rounding moves a radiosity"));
  }
  EXPECT_EQ(solve(scene, {}).report["storage"]["format"], "dense32") << "auto, on OpenMP";
}

/// Between walls that keep 99.5 % of the light rounding is magnified two hundred times.
TEST(SolveStorage, AFormatThatRoundsTooMuchIsRefused) {
  const Folder folder;
  std::string scene = content_of(scene_file("furnace.obj"));
  scene.replace(scene.find("furnace.mtl"), 11, "bright.mtl");
  static_cast<void>(folder.write("bright.mtl", "newmtl glowing\nKd 0.995 0.995 0.995\nKe 0.5 1.5 0.6\n"));
  const Solved solved = solve(folder.write("bright.obj", scene), {"--storage", "sym16", "--tol", "1e-4"});
  EXPECT_EQ(solved.report["storage"]["format"], "dense32");
  EXPECT_THAT(solved.outcome.err, HasSubstr("sym16 is refused: its rounding moves a radiosity by"));
  EXPECT_THAT(solved.outcome.err, HasSubstr("solving with dense32"));
  EXPECT_THAT(std::string(solved.report["storage"]["refused"]), HasSubstr("sym16: its rounding moves"));
  EXPECT_TRUE(solved.report["storage"]["rounding_error"].is_null());
  EXPECT_GT(solved.report["seconds"]["pack"], 0.0);
}

/// A given number of bounces is no solution that could be judged, and the report says that it was not.
TEST(SolveStorage, AFixedNumberOfIterationsIsNotJudged) {
  const Solved solved = solve(scene_file("cornell-box.obj"), {"--storage", "tiled16", "--iterations", "3"});
  EXPECT_EQ(solved.report["storage"]["format"], "tiled16");
  EXPECT_TRUE(solved.report["storage"]["rounding_error"].is_null());
  EXPECT_TRUE(solved.report["storage"]["refused"].is_null());
  EXPECT_THAT(solved.outcome.out, HasSubstr("the error of its rounding was not measured"));
}

TEST(SolveStorage, AnUnknownFormatIsAUsageError) {
  const Outcome outcome = run_program({"solve", scene_file("furnace.obj"), "--storage", "sym8"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("sym8"));
}

}  // namespace
}  // namespace interflect::test
