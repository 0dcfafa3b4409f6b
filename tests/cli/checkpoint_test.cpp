// solve --checkpoint: killed, refused, damaged, on a full disk.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program.h"

namespace interflect {
namespace {

using namespace test;
using nlohmann::json;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// A closed box of 192 patches in which Jacobi takes hundreds of iterations.
struct Slow {
  explicit Slow(const std::string& reflectance = "0.97", const std::string& light = "0.5 1.5 0.6") {
    scene = folder.write("slow.obj", content_of(scene_file("furnace.obj")));
    paint(reflectance, light);
  }
  void paint(const std::string& reflectance, const std::string& light = "0.5 1.5 0.6") const {
    static_cast<void>(
        folder.write("furnace.mtl", fmt::format("newmtl glowing\nKd {0} {0} {0}\nKe {1}\n", reflectance, light)));
  }
  [[nodiscard]] std::vector<std::string> command(const std::vector<std::string>& more) const {
    std::vector<std::string> all{"solve",    scene,    "--divide",     "0.1",        "--method", "jacobi",
                                 "--report", report(), "--checkpoint", checkpoint(), "-o",       folder.file("b.csv")};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  [[nodiscard]] Outcome solve(const std::vector<std::string>& more = {}) const { return run_program(command(more)); }
  [[nodiscard]] std::string checkpoint() const { return folder.file("slow.ckp"); }
  [[nodiscard]] std::string report() const { return folder.file("report.json"); }
  [[nodiscard]] json told() const { return json::parse(content_of(report())); }
  /// The radiosities of the result.
  [[nodiscard]] std::vector<double> radiosities() const {
    std::vector<double> out;
    std::istringstream lines(content_of(folder.file("b.csv")));
    std::string line, cell;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      std::istringstream cells(line);
      for (int column = 0; std::getline(cells, cell, ','); ++column) {
        if (column >= 15 && column < 18) out.push_back(std::stod(cell));
      }
    }
    return out;
  }
  /// Iterations in the checkpoint as it lies there now; 0: none.
  [[nodiscard]] std::uint32_t kept() const {
    const std::string bytes = content_of(checkpoint());
    std::uint32_t made = 0;
    if (bytes.size() > 92) std::memcpy(&made, bytes.data() + 88, sizeof made);
    return made;
  }
  /// Kills the program, by nothing that it could catch, once so many iterations are kept.
  void kill_after(std::uint32_t iterations) const {
    const std::vector<std::string> words = command({"--every", "0s", "--quiet", "--tol", "1e-5"});
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      std::vector<char*> arguments{const_cast<char*>("interflect")};
      for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
      arguments.push_back(nullptr);
      ::execv(INTERFLECT_PROGRAM, arguments.data());
      ::_exit(127);
    }
    while (kept() < iterations) {
      ASSERT_EQ(::waitpid(child, nullptr, WNOHANG), 0) << "ended before it was killed";
      ::usleep(200);
    }
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
  }
  Folder folder;
  std::string scene;
};

double difference(const std::vector<double>& a, const std::vector<double>& b) {
  double off = 0, largest = 0;
  EXPECT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    off = std::max(off, std::abs(a[i] - b[i]));
    largest = std::max(largest, std::abs(b[i]));
  }
  return off / largest;
}

TEST(CheckpointTest, AKilledSolveGoesOn) {
  const Slow slow;
  const std::vector<std::string> well{"--tol", "1e-5"};  // a smaller one is near what an fp32 b can express
  ASSERT_EQ(slow.solve(well).status, 0);
  const std::vector<double> whole = slow.radiosities();
  const int scratch = slow.told()["products"];
  EXPECT_EQ(slow.told()["checkpoint"]["iterations_before"], 0);
  EXPECT_FALSE(std::filesystem::exists(slow.checkpoint()));  // the solve is done
  std::filesystem::remove(slow.folder.file("b.csv"));

  slow.kill_after(120);
  ASSERT_FALSE(std::filesystem::exists(slow.folder.file("b.csv")));
  const std::uint32_t kept = slow.kept();
  EXPECT_GE(kept, 120U);
  // Another tolerance would be fine as well, and another device: the file knows neither.
  const Outcome rest = slow.solve(well);
  EXPECT_EQ(rest.status, 0);
  EXPECT_THAT(rest.err, HasSubstr(fmt::format("going on after {} iterations", kept)));
  const json told = slow.told();
  EXPECT_EQ(told["checkpoint"]["iterations_before"], kept);
  EXPECT_LT(told["products"].get<int>() - told["checkpoint"]["products_before"].get<int>(), scratch - 100);
  EXPECT_TRUE(told["converged"]);
  EXPECT_LT(difference(slow.radiosities(), whole), 7e-4);  // each is within 1e-5 / (1 - 0.97) of the solution
  EXPECT_FALSE(std::filesystem::exists(slow.checkpoint()));
}

TEST(CheckpointTest, AFixedNumberOfBouncesGoesOnToThatNumber) {
  const Slow slow;
  const std::vector<std::string> bounces{"--iterations", "60"};
  ASSERT_EQ(slow.solve(bounces).status, 0);
  const std::vector<double> whole = slow.radiosities();
  ASSERT_EQ(slow.solve({"--max-iterations", "20"}).status, 5);
  EXPECT_EQ(slow.kept(), 20U);
  const Outcome other = slow.solve(bounces);  // towards a tolerance is another solve
  EXPECT_EQ(other.status, 3);
  EXPECT_THAT(other.error_lines(), ElementsAre(HasSubstr("--iterations goes on only from")));
  EXPECT_EQ(difference(slow.radiosities(), whole) > 0.1, true);  // 20 bounces are not 60
}

TEST(CheckpointTest, AnotherSolvesCheckpointIsRefusedAndStays) {
  const Slow slow;
  ASSERT_EQ(slow.solve({"--max-iterations", "20"}).status, 5);
  const std::string before = content_of(slow.checkpoint());
  const auto refused = [&](const std::vector<std::string>& more) {
    const Outcome outcome = slow.solve(more);
    EXPECT_EQ(outcome.status, 3) << outcome.err;
    EXPECT_EQ(outcome.error_lines().size(), 1U);
    EXPECT_EQ(content_of(slow.checkpoint()), before);
    return outcome.err;
  };
  slow.paint("0.96");
  EXPECT_THAT(refused({}), HasSubstr("reflectances are others"));
  slow.paint("0.97", "0.5 1.5 0.7");
  EXPECT_THAT(refused({}), HasSubstr("lights are others"));
  slow.paint("0.97");
  EXPECT_THAT(refused({"--two-sided"}), HasSubstr("patches"));
  EXPECT_EQ(slow.solve({"--tol", "1e-2", "--device", "openmp", "--storage", "sym16"}).status, 0);
}

TEST(CheckpointTest, ADamagedOneIsNamedAndNotTrusted) {
  const Slow slow;
  ASSERT_EQ(slow.solve({"--max-iterations", "20"}).status, 5);
  const std::string good = content_of(slow.checkpoint());
  std::string bad = good;
  bad[300] = static_cast<char>(bad[300] ^ 1);  // one bit of one radiosity
  for (const std::string& bytes : {bad, good.substr(0, 200), std::string("o cube\n")}) {
    static_cast<void>(slow.folder.write("slow.ckp", bytes));
    const Outcome outcome = slow.solve();
    EXPECT_EQ(outcome.status, 3);
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("slow.ckp: is ")));
    EXPECT_EQ(content_of(slow.checkpoint()), bytes);
  }
  static_cast<void>(slow.folder.write("slow.ckp", good));  // the twin
  EXPECT_EQ(slow.solve({"--tol", "1e-3"}).status, 0);
}

TEST(CheckpointTest, AFullDiskLeavesTheOneFromBeforeAndTheSolveGoesOn) {
  const Slow slow;
  ASSERT_EQ(slow.solve({"--max-iterations", "20"}).status, 5);
  const std::string before = content_of(slow.checkpoint());
  ASSERT_GT(before.size(), 2048U);
  const std::string script =
      slow.folder.write("run.sh", "ulimit -f 4\nexec \"$@\"\n");  // LLVM's OpenMP needs a file of 1 KiB
  std::string command = "sh '" + script + "' '" + INTERFLECT_PROGRAM + "'";
  for (const std::string& word :
       {std::string("solve"), slow.scene, std::string("--divide"), std::string("0.1"), std::string("--method"),
        std::string("jacobi"), std::string("--checkpoint"), slow.checkpoint(), std::string("--every"),
        std::string("0s"), std::string("--max-iterations"), std::string("40")}) {
    command += " '" + word + "'";
  }
  command += " 2>'" + slow.folder.file("said") + "' >/dev/null";
  const int status = std::system(command.c_str());
  EXPECT_EQ(WEXITSTATUS(status), 5);  // 40 iterations are done, and not one more
  const std::string said = content_of(slow.folder.file("said"));
  EXPECT_THAT(said, HasSubstr("the checkpoint is not kept"));
  EXPECT_EQ(said.find("not kept"), said.rfind("not kept"));  // told once
  EXPECT_EQ(content_of(slow.checkpoint()), before);
  for (const std::string& name : slow.folder.names()) EXPECT_THAT(name, Not(HasSubstr(".part"))) << name;
  EXPECT_EQ(slow.solve({"--max-iterations", "40"}).status, 5);  // the twin: with room there is a newer one
  EXPECT_EQ(slow.kept(), 40U);
}

TEST(CheckpointTest, LightGroupsAreColumnsOfTheirOwn) {
  const Folder folder;
  const auto solve = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"solve", scene_file("room-1312.obj"), "--patches", "200", "--checkpoint",
                               folder.file("a.ckp"), "--report", folder.file("a.json")});
    return run_program(more);
  };
  ASSERT_EQ(solve({"--light-groups", "object", "--max-iterations", "3"}).status, 5);
  const Outcome together = solve({});
  EXPECT_EQ(together.status, 3);
  EXPECT_THAT(together.err, HasSubstr("light groups are others"));
  EXPECT_EQ(solve({"--light-groups", "object"}).status, 0);
  EXPECT_EQ(json::parse(content_of(folder.file("a.json")))["checkpoint"]["iterations_before"], 3);
}

TEST(CheckpointTest, UsageIsChecked) {
  const Slow slow;
  EXPECT_EQ(run_program({"solve", slow.scene, "--every", "3s"}).status, 2);
  EXPECT_EQ(slow.solve({"--every", "soon"}).status, 2);
  EXPECT_EQ(slow.solve({"--every", "-1s"}).status, 2);
  EXPECT_EQ(run_program({"solve", slow.scene, "--checkpoint", slow.scene}).status, 2);
  EXPECT_EQ(run_program({"solve", slow.scene, "--checkpoint", slow.folder.file("furnace.mtl")}).status, 2);
}

}  // namespace
}  // namespace interflect
