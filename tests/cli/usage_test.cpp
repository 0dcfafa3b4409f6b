// Wrong options end with status 2 and one line, before any work.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::HasSubstr;

class Usage : public ::testing::TestWithParam<std::pair<std::vector<std::string>, std::string>> {};

TEST_P(Usage, IsRefusedInOneLineWithStatus2) {
  const auto& [arguments, named] = GetParam();
  const Outcome outcome = run_program(arguments);
  EXPECT_EQ(outcome.status, 2) << outcome.err;
  ASSERT_EQ(outcome.error_lines().size(), 1U) << outcome.err;
  EXPECT_THAT(outcome.error_lines().front(), HasSubstr(named));
  EXPECT_EQ(outcome.out, "");
}

const std::string box = scene_file("furnace.obj");

INSTANTIATE_TEST_SUITE_P(
    Options, Usage,
    ::testing::Values(
        std::pair{std::vector<std::string>{}, std::string("subcommand")},
        std::pair{std::vector<std::string>{"paint"}, std::string("paint")},
        std::pair{std::vector<std::string>{"solve"}, std::string("a scene is needed")},
        std::pair{std::vector<std::string>{"view"}, std::string("SCENE")},
        std::pair{std::vector<std::string>{"solve", box, "--divide", "x"}, std::string("--divide")},
        std::pair{std::vector<std::string>{"solve", box, "--divide", "-1"}, std::string("--divide")},
        std::pair{std::vector<std::string>{"solve", box, "--divide", "nan"}, std::string("--divide")},
        std::pair{std::vector<std::string>{"solve", box, "--divide", "1", "--patches", "9"}, std::string("--patches")},
        std::pair{std::vector<std::string>{"solve", box, "--patches", "-4"}, std::string("--patches")},
        std::pair{std::vector<std::string>{"solve", box, "--patches", "0"}, std::string("--patches")},
        std::pair{std::vector<std::string>{"solve", box, "--method", "gauss"}, std::string("--method")},
        std::pair{std::vector<std::string>{"solve", box, "--tol", "0"}, std::string("--tol")},
        std::pair{std::vector<std::string>{"solve", box, "--tol", "nan"}, std::string("--tol")},
        std::pair{std::vector<std::string>{"solve", box, "--max-iterations", "-1"}, std::string("--max-iterations")},
        std::pair{std::vector<std::string>{"solve", box, "--storage", "sparse"}, std::string("--storage")},
        std::pair{std::vector<std::string>{"solve", box, "--size", "12"}, std::string("--size")},
        std::pair{std::vector<std::string>{"solve", box, "--size", "0x9"}, std::string("--size")},
        std::pair{std::vector<std::string>{"solve", box, "--camera", "1,2"}, std::string("--camera")},
        std::pair{std::vector<std::string>{"solve", box, "--camera", "1,2,3,1,2,3"}, std::string("--camera")},
        std::pair{std::vector<std::string>{"solve", box, "--exposure", "nan"}, std::string("--exposure")},
        std::pair{std::vector<std::string>{"solve", box, "-o", "x.tiff"}, std::string(".tiff")},
        std::pair{std::vector<std::string>{"solve", box, "-o", "a.ply", "-o", "a.ply"}, std::string("twice")},
        std::pair{std::vector<std::string>{"solve", box, "-o", "a.ply", "-o", "./a.ply"}, std::string("twice")},
        std::pair{std::vector<std::string>{"solve", box, "--report", ""}, std::string("--report")},
        std::pair{std::vector<std::string>{"solve", box, "--report", box}, std::string("is the scene")},
        std::pair{std::vector<std::string>{"solve", box, "--up", "0,0,1"}, std::string("--camera")},
        std::pair{std::vector<std::string>{"bench", "--study", "--csv", "a.csv"}, std::string("--csv")},
        std::pair{std::vector<std::string>{"bench", "--study", "--peers"}, std::string("--peers")},
        std::pair{std::vector<std::string>{"bench", "--peers", "openblas"}, std::string("openblas")},
        std::pair{std::vector<std::string>{"bench", "--study", "--room", "1313"}, std::string("--room")},
        std::pair{std::vector<std::string>{"bench", "--study", "--json", ""}, std::string("--json")},
        std::pair{std::vector<std::string>{"bench", "--study", "--repetitions", "0"}, std::string("--repetitions")},
        std::pair{std::vector<std::string>{"bench", "--csv", ""}, std::string("--csv")},
        std::pair{std::vector<std::string>{"bench", "--storage", "dense64"}, std::string("'dense64' is no storage")},
        std::pair{std::vector<std::string>{"bench", "--storage", "dense32,"}, std::string("'' is no storage")},
        std::pair{std::vector<std::string>{"bench", "--storage", ""}, std::string("--storage")},
        std::pair{std::vector<std::string>{"bench", "--storage", "sym16,sym16"}, std::string("twice")},
        std::pair{std::vector<std::string>{"bench", "--storage", "all,sym16"}, std::string("'all' is no storage")},
        std::pair{std::vector<std::string>{"bench", "--plot", "p.png"}, std::string("neither in .html nor in .svg")},
        std::pair{std::vector<std::string>{"bench", "--plot", ""}, std::string("--plot")},
        std::pair{std::vector<std::string>{"bench", "--growth-max", "0"}, std::string("--growth-max")},
        std::pair{std::vector<std::string>{"bench", "--growth-max", "nan"}, std::string("--growth-max")},
        std::pair{std::vector<std::string>{"bench", "--repetitions", "-1"}, std::string("--repetitions")},
        std::pair{std::vector<std::string>{"bench", "--room", "77"}, std::string("--room")},
        std::pair{std::vector<std::string>{"bench", "--study", "--plot", "p.svg"}, std::string("--plot")},
        std::pair{std::vector<std::string>{"bench", "--from", "a.json", "--room", "1312"}, std::string("--from")},
        std::pair{std::vector<std::string>{"bench", "--json", "a.json", "--plot", "a.json"}, std::string("neither")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "vulkan:99", "--divide", "1"},
                  std::string("openmp")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp,openmp"}, std::string("twice")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp,"}, std::string("no device ''")},
        std::pair{std::vector<std::string>{"solve", box, "--device", ""}, std::string("auto, ")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp,tpu:0"}, std::string("'tpu:0'; there")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "auto,openmp"}, std::string("alone")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp,all"}, std::string("alone")},
        std::pair{std::vector<std::string>{"solve", box, "--split", "1"}, std::string("--split needs the devices")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp", "--split", "1,4"},
                  std::string("2 shares for 1 devices")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp", "--split", "much"},
                  std::string("'much' is no share")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp", "--split", "-1"}, std::string("'-1'")},
        std::pair{std::vector<std::string>{"solve", box, "--device", "openmp", "--split", "0"}, std::string("above 0")},
        std::pair{std::vector<std::string>{"bench", "--hybrid", "--room", "1312"}, std::string("--hybrid")},
        std::pair{std::vector<std::string>{"bench", "--device", "openmp,openmp:1"}, std::string("'openmp:1'")},
        std::pair{std::vector<std::string>{"view", box, "extra"}, std::string("extra")},
        std::pair{std::vector<std::string>{"formfactors", box, "--group-by", "colour"}, std::string("--group-by")},
        std::pair{std::vector<std::string>{"formfactors", box, "--memory", "much"}, std::string("--memory")},
        std::pair{std::vector<std::string>{"solve", box, "--memory", "nan"}, std::string("'nan' is not a size")},
        std::pair{std::vector<std::string>{"check", "--device", "cuda:7"}, std::string("cuda:7")}));

/// `auto`, as for solve.
TEST(Usage, FormfactorsTakesTheDeviceThatSolveTakes) {
  for (const char* command : {"solve", "formfactors"}) {
    EXPECT_THAT(run_program({command, "--help"}).out, HasSubstr("--device TEXT=auto ")) << command;
  }
}

TEST(Usage, AnUnknownDeviceIsFoundBeforeTheFormFactors) {
  // A scene that would take minutes: the answer must come at once all the same (the test's own time limit is the
  // judge).
  const Outcome outcome = run_program({"solve", box, "--patches", "40000", "--device", "openmp:7"});
  EXPECT_EQ(outcome.status, 2);
}

}  // namespace
}  // namespace interflect::test
