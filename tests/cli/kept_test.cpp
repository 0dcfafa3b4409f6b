// Form factors kept in a file: interrupted in every way, resumed, repaired, reused, exported.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <thread>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::AnyOf;
using ::testing::Eq;
using ::testing::HasSubstr;
using ::testing::Not;

const std::string small_panels = "INTERFLECT_MAX_PANEL_BYTES=100000";  // 32 rows of 820: 26 panels
const std::string quiet_threads = "OMP_WAIT_POLICY=passive";           // waiting threads leave the cores to the others

std::vector<std::string> keeping(const std::string& file) {
  return {"formfactors", scene_file("cornell-box.obj"), "--divide", "4000", "-o", file};
}

/// The program as a process that the test can signal, with small panels.
class Running {
 public:
  Running(const std::vector<std::string>& arguments, std::string errors, rlim_t largest_file = RLIM_INFINITY)
      : errors_(std::move(errors)) {
    std::vector<char*> argv{const_cast<char*>(INTERFLECT_PROGRAM)};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    const int null = ::open("/dev/null", O_RDWR | O_CLOEXEC);
    const int err = ::open(errors_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    std::string panels = small_panels, threads = quiet_threads;
    pid_ = ::fork();
    if (pid_ == 0) {
      struct rlimit limit {};
      ::getrlimit(RLIMIT_FSIZE, &limit);
      if (largest_file != RLIM_INFINITY) limit.rlim_cur = largest_file;
      ::setrlimit(RLIMIT_FSIZE, &limit);
      ::dup2(null, 0);
      ::dup2(null, 1);
      ::dup2(err, 2);
      ::putenv(panels.data());
      ::putenv(threads.data());
      ::execv(argv[0], argv.data());
      ::_exit(99);
    }
    ::close(null);
    ::close(err);
  }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  ~Running() {
    if (pid_ > 0) {
      signal(SIGKILL);
      (void)wait();
    }
  }

  void signal(int number) const { ::kill(pid_, number); }
  /// The exit status, 128 + signal when one ended it.
  int wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  [[nodiscard]] std::string errors() const { return content_of(errors_); }

 private:
  std::string errors_;
  pid_t pid_ = -1;
};

/// How many entries of the table say that their panel is finished.
std::uint32_t finished_panels(const std::string& file) {
  const std::string front = content_of(file).substr(0, 4096 + 64 * 64);
  std::uint32_t count = 0, panels = 0;
  if (front.size() < 4096) return 0;
  std::memcpy(&panels, front.data() + 28, sizeof panels);
  for (std::uint32_t p = 0; p < panels && 4096 + 64 * (p + 1) <= front.size(); ++p) {
    count += front[4096 + 64 * p] == 1 ? 1 : 0;
  }
  return count;
}

void wait_for_panels(const std::string& file, std::uint32_t panels) {
  for (int k = 0; k < 60'000 && finished_panels(file) < panels; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

TEST(Kept, KilledAtAnyMomentItGoesOnAndGivesTheSameFile) {
  const Folder folder;
  const std::string whole = folder.file("whole.iff"), file = folder.file("room.iff");
  const auto begin = std::chrono::steady_clock::now();
  Running undisturbed(keeping(whole), folder.file("err"));
  ASSERT_EQ(undisturbed.wait(), 0) << undisturbed.errors();
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  const std::string bytes = content_of(whole);

  std::mt19937 random(5);  // NOLINT: the same moments, as shares of a run, every time
  std::uniform_real_distribution<double> share(0.0, 1.0);
  int killed = 0, midway = 0, completed = 0;
  for (int runs = 0; killed < 20 && runs < 80; ++runs) {
    Running victim(keeping(file), folder.file("err"));
    std::this_thread::sleep_for(took * share(random));
    victim.signal(SIGKILL);
    const int status = victim.wait();
    ASSERT_THAT(status, AnyOf(Eq(128 + SIGKILL), Eq(0))) << victim.errors();
    if (status == 0) {
      ++completed;
      EXPECT_TRUE(content_of(file) == bytes) << "completed after " << killed << " kills";
      std::filesystem::remove(file);
      continue;
    }
    ++killed;
    const std::uint32_t panels = finished_panels(file + ".partial");
    midway += panels > 0 && panels < 26 ? 1 : 0;
  }
  EXPECT_EQ(killed, 20);
  EXPECT_GE(midway, 3) << "of the kills hit an assembly under way";
  Running last(keeping(file), folder.file("err"));
  EXPECT_EQ(last.wait(), 0) << last.errors();
  EXPECT_TRUE(content_of(file) == bytes);
  // The twin: another seed is another file.
  std::vector<std::string> other = keeping(folder.file("other.iff"));
  other.insert(other.end(), {"--seed", "2"});
  EXPECT_EQ(run_program(other, {small_panels, quiet_threads}).status, 0);
  EXPECT_FALSE(content_of(folder.file("other.iff")) == bytes);
}

TEST(Kept, CtrlCFinishesThePanelAndSaysHowToGoOn) {
  const Folder folder;
  const std::string file = folder.file("room.iff");
  for (const int number : {SIGINT, SIGTERM}) {
    Running run(keeping(file), folder.file("err"));
    wait_for_panels(file + ".partial", 1);
    run.signal(number);
    EXPECT_EQ(run.wait(), 130);
    EXPECT_THAT(run.errors(), HasSubstr("finishing the panel in hand"));
    EXPECT_THAT(run.errors(), HasSubstr("of 26 panels are kept in " + file + ".partial, and the same command goes on"));
    EXPECT_FALSE(std::filesystem::exists(file));
    std::filesystem::remove(file + ".partial");
  }
  Running twice(keeping(file), folder.file("err"));
  wait_for_panels(file + ".partial", 1);
  twice.signal(SIGINT);
  twice.signal(SIGTERM);
  EXPECT_THAT(twice.wait(), AnyOf(130, 128 + SIGTERM));  // whichever of its threads was first
  const std::uint32_t kept = finished_panels(file + ".partial");
  EXPECT_GE(kept, 1U);
  const Outcome again = run_program(keeping(file), {small_panels, quiet_threads});
  EXPECT_EQ(again.status, 0);
  EXPECT_THAT(again.err, HasSubstr("going on after " + std::to_string(kept) + " of 26 panels"));
  ASSERT_EQ(run_program(keeping(folder.file("whole.iff")), {small_panels, quiet_threads}).status, 0);
  EXPECT_TRUE(content_of(file) == content_of(folder.file("whole.iff")));
}

TEST(Kept, AFullDiskIsOneLineAndLeavesTheFinishedPanels) {
  const Folder folder;
  const std::string file = folder.file("room.iff");
  Running run(keeping(file), folder.file("err"), 1'000'000);
  EXPECT_EQ(run.wait(), 6);
  const std::uint32_t kept = finished_panels(file + ".partial");
  EXPECT_GE(kept, 5U);
  EXPECT_THAT(run.errors(), HasSubstr("interflect: error: " + file + ".partial: cannot write: File too large (panel " +
                                      std::to_string(kept)));
  EXPECT_THAT(run.errors(), HasSubstr(std::to_string(kept) + " of 26 panels are kept"));
  // Mistyped options do not cost the finished panels.
  std::vector<std::string> mistyped = keeping(file);
  mistyped.insert(mistyped.end(), {"--accuracy", "low"});
  const Outcome refused = run_program(mistyped, {small_panels, quiet_threads});
  EXPECT_EQ(refused.status, 3);
  EXPECT_THAT(refused.err, HasSubstr(file + ".partial: its accuracy is 0.005, 0.02 is asked; " + std::to_string(kept) +
                                     " of its 26 panels are finished: give the options"));
  const Outcome again = run_program(keeping(file), {small_panels, quiet_threads});
  EXPECT_EQ(again.status, 0);
  EXPECT_THAT(again.err, HasSubstr("going on after " + std::to_string(kept) + " of 26 panels"));
}

/// The Cornell box's factors, kept once for the tests below.
class KeptBox : public ::testing::Test {
 protected:
  KeptBox() {
    const Outcome made = run_program(arguments({"-o", file}), {"INTERFLECT_MAX_PANEL_BYTES=1000000", quiet_threads});
    EXPECT_EQ(made.status, 0) << made.err;
    bytes = content_of(file);
  }
  static std::vector<std::string> arguments(const std::vector<std::string>& more) {
    std::vector<std::string> all{"formfactors", scene_file("cornell-box.obj"), "--divide", "4000"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  static json report(const Outcome& outcome) {
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return json::parse(outcome.out);
  }
  [[nodiscard]] Outcome solve(const std::vector<std::string>& more, const std::string& scene = "") const {
    std::vector<std::string> all{"solve",          scene.empty() ? scene_file("cornell-box.obj") : scene,
                                 "--form-factors", file,
                                 "--report",       folder.file("report.json")};
    all.insert(all.end(), more.begin(), more.end());
    return run_program(all);
  }

  Folder folder;
  std::string file = folder.file("box.iff");
  std::string bytes;
};

TEST_F(KeptBox, AFileThatFitsIsReused) {
  const Outcome again = run_program(arguments({"-o", file, "--json"}));
  EXPECT_THAT(again.err, HasSubstr("is there and fits"));
  const json kept = report(again)["form_factors"];
  EXPECT_EQ(kept["done"], "reused");
  EXPECT_EQ(kept["panels"], 3);
  EXPECT_EQ(kept["panels_reused"], 3);
  EXPECT_TRUE(content_of(file) == bytes);
  // Twins: what does not fit is computed.
  const Outcome finer = run_program(arguments({"-o", file, "--json", "--accuracy", "0.004"}));
  EXPECT_THAT(finer.err, HasSubstr("its --accuracy is medium, asked is 0.004"));
  EXPECT_EQ(report(finer)["form_factors"]["done"], "computed");
  EXPECT_FALSE(content_of(file) == bytes);
}

TEST_F(KeptBox, SolveTakesTheFileAndItsDivide) {
  const Outcome without = run_program({"solve", scene_file("cornell-box.obj"), "--divide", "4000", "-o",
                                       folder.file("without.npy"), "--report", folder.file("without.json")});
  ASSERT_EQ(without.status, 0) << without.err;
  const Outcome with = solve({"-o", folder.file("with.npy")});
  ASSERT_EQ(with.status, 0) << with.err;
  EXPECT_THAT(with.err, HasSubstr(file + ": its form factors are used (accuracy medium, seed 1)"));
  EXPECT_TRUE(content_of(folder.file("with.npy")) == content_of(folder.file("without.npy")));
  const json a = json::parse(content_of(folder.file("report.json")));
  const json b = json::parse(content_of(folder.file("without.json")));
  EXPECT_EQ(a["closure"], b["closure"]);
  EXPECT_EQ(a["patches"], 820);
  EXPECT_EQ(a["estimated_error"], b["estimated_error"]);
  EXPECT_EQ(a["form_factors"]["done"], "reused");
  EXPECT_TRUE(b["form_factors"].is_null());
}

TEST_F(KeptBox, SolveMakesTheFileWhereItIsNotThere) {
  std::filesystem::remove(file);
  const Outcome made = solve({"--divide", "4000"});
  EXPECT_EQ(made.status, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("kept           " + file + ": computed"));
  EXPECT_EQ(solve({}).status, 0);
}

TEST_F(KeptBox, WhatDoesNotFitIsRefusedByName) {
  const auto refused = [&](const std::vector<std::string>& more, const std::string& scene = "") {
    const Outcome outcome = solve(more, scene);
    EXPECT_EQ(outcome.status, 3) << outcome.err;
    EXPECT_EQ(outcome.error_lines().size(), 1U);
    return outcome.err;
  };
  EXPECT_THAT(refused({"--divide", "1000"}),
              HasSubstr("it was cut with --divide 4000 into 820 patches, asked is 1000"));
  EXPECT_THAT(refused({"--accuracy", "high"}), HasSubstr("its --accuracy is medium, asked is high"));
  EXPECT_THAT(refused({"--seed", "9"}), HasSubstr("its --seed is 1, asked is 9"));
  EXPECT_THAT(refused({"--two-sided"}), HasSubstr("it was made without --two-sided"));
  EXPECT_THAT(refused({}, scene_file("furnace.obj")), HasSubstr("its geometry is another: 820 patches"));
  EXPECT_TRUE(content_of(file) == bytes);
  EXPECT_EQ(solve({"--accuracy", "low"}).status, 0) << "finer than asked fits";
  EXPECT_EQ(solve({"--divide", "4000", "--seed", "1"}).status, 0);
}

TEST_F(KeptBox, AnotherClosureUsesThePanels) {
  const Outcome closed = solve({"--closure", "on"});
  EXPECT_EQ(closed.status, 0) << closed.err;
  EXPECT_THAT(closed.err, HasSubstr("the closure is found anew"));
  const json solved = json::parse(content_of(folder.file("report.json")));
  EXPECT_EQ(solved["form_factors"]["panels_reused"], 3);
  EXPECT_TRUE(solved["closure"]["applied"]);
  EXPECT_TRUE(content_of(file) == bytes) << "solve leaves the file alone";
  const json again = report(run_program(arguments({"-o", file, "--closure", "on", "--json"})));
  EXPECT_EQ(again["form_factors"]["done"], "closure found anew");
  EXPECT_TRUE(again["closure"]["applied"]);
  EXPECT_EQ(run_program(arguments({"-o", file})).status, 0);
  EXPECT_TRUE(content_of(file) == bytes) << "and back";
}

/// What a kill or a full disk leaves while the end is written anew.
TEST_F(KeptBox, ABrokenEndIsWrittenAgainByTheSameCommand) {
  std::uint64_t end = 0;
  std::memcpy(&end, bytes.data() + 112, sizeof end);
  const std::vector<std::string> closing = arguments({"-o", file, "--closure", "on"});
  ASSERT_EQ(run_program(closing).status, 0);
  const std::string closed = content_of(file);
  EXPECT_FALSE(closed == bytes);
  static_cast<void>(folder.write("box.iff", bytes));
  Running full(closing, folder.file("err"), end + 20);
  EXPECT_EQ(full.wait(), 6);
  EXPECT_THAT(full.errors(), HasSubstr("3 of 3 panels are kept in " + file + ", and the same command goes on"));
  EXPECT_THAT(run_program({"formfactors", file}).err, HasSubstr("closing section: "));
  const std::string broken = content_of(file);
  const Outcome solved = solve({"--closure", "on"});
  EXPECT_EQ(solved.status, 0) << solved.err;
  EXPECT_THAT(solved.err, HasSubstr("the closure is found anew"));
  EXPECT_TRUE(content_of(file) == broken) << "solve leaves the file alone";
  const Outcome streamed = solve({"--closure", "on", "--memory", "2500K"});
  EXPECT_EQ(streamed.status, 0) << streamed.err;
  const Outcome again = run_program(closing);
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr(file + ": closing section: "));
  EXPECT_THAT(again.err, HasSubstr(": its panels are used, the closure is found anew"));
  EXPECT_TRUE(content_of(file) == closed);
}

TEST_F(KeptBox, EmissionAndReflectanceMayChange) {
  std::string looks = content_of(scene_file("cornell-box.mtl"));
  const std::string obj = folder.write("cornell-box.obj", content_of(scene_file("cornell-box.obj")));
  for (std::size_t at = looks.find("Ke "); at != std::string::npos; at = looks.find("Ke ", at + 1)) {
    looks.replace(at, looks.find('\n', at) - at, "Ke 0.5 0.25 1");
  }
  static_cast<void>(folder.write("cornell-box.mtl", looks));
  const Outcome brighter = solve({"-o", folder.file("bright.npy")}, obj);
  EXPECT_EQ(brighter.status, 0) << brighter.err;
  EXPECT_EQ(solve({"-o", folder.file("dark.npy")}).status, 0);
  EXPECT_FALSE(content_of(folder.file("bright.npy")) == content_of(folder.file("dark.npy")));
}

TEST_F(KeptBox, DamageIsNamedAndRepaired) {
  std::string damaged = bytes;
  damaged.at(damaged.size() / 2) ^= 4;
  static_cast<void>(folder.write("box.iff", damaged));
  for (const Outcome& outcome : {solve({}), run_program({"formfactors", file}), run_program(arguments({"-o", file}))}) {
    EXPECT_EQ(outcome.status, 3);
    EXPECT_EQ(outcome.error_lines().size(), 1U);
    EXPECT_THAT(outcome.err, HasSubstr(file + ": panel 1 (rows 288 to 575): checksum differs; `--repair`"));
  }
  const json repaired = report(run_program(arguments({"-o", file, "--repair", "--json"})));
  EXPECT_EQ(repaired["form_factors"]["done"], "repaired");
  EXPECT_EQ(repaired["form_factors"]["panels_reused"], 2);
  EXPECT_TRUE(content_of(file) == bytes);
  EXPECT_EQ(report(run_program(arguments({"-o", file, "--repair", "--json"})))["form_factors"]["done"],
            "nothing was damaged");
  EXPECT_EQ(run_program({"formfactors", file, "--repair"}).status, 2);
  EXPECT_EQ(run_program(arguments({"-o", folder.file("none.iff"), "--repair"})).status, 3);
  // What is not known to be of this scene and these options is left as it is.
  damaged = bytes;
  damaged[70] ^= 4;
  for (const std::string& content : {damaged, std::string("not form factors")}) {
    static_cast<void>(folder.write("box.iff", content));
    const Outcome refused = run_program(arguments({"-o", file, "--repair", "--accuracy", "high"}));
    EXPECT_EQ(refused.status, 3);
    EXPECT_EQ(refused.error_lines().size(), 1U);
    EXPECT_TRUE(content_of(file) == content);
  }
  EXPECT_THAT(run_program({"formfactors", file}).err, HasSubstr("is not a file of form factors"));
}

TEST_F(KeptBox, BetweenIsTheSameFromTheFile) {
  for (const std::string by : {"auto", "object", "material"}) {
    const json from_scene = report(run_program(arguments({"--between", "--json", "--group-by", by})));
    const json from_file = report(run_program({"formfactors", file, "--between", "--json", "--group-by", by}));
    EXPECT_EQ(from_scene, from_file) << by;
    EXPECT_GT(from_file["groups"].size(), 2U);
  }
  EXPECT_EQ(run_program({"formfactors", file, "--divide", "3"}).status, 2);
  const json alone = report(run_program({"formfactors", file, "--json"}));
  EXPECT_EQ(alone["patches"], 820);
  EXPECT_EQ(alone["closure"], report(run_program(arguments({"--json"})))["closure"]);
}

/// The float32 values behind the header of a .npy file of version 1.0.
std::vector<float> npy_values(const std::string& content) {
  const std::size_t header =
      static_cast<unsigned char>(content.at(8)) + 256U * static_cast<unsigned char>(content.at(9));
  std::vector<float> values((content.size() - 10 - header) / sizeof(float));
  std::memcpy(values.data(), content.data() + 10 + header, values.size() * sizeof(float));
  return values;
}

TEST_F(KeptBox, ExportsHoldF) {
  const Outcome direct = run_program(arguments({"-o", folder.file("f.npy"), "-o", folder.file("f.mtx")}));
  ASSERT_EQ(direct.status, 0) << direct.err;
  const Outcome kept = run_program({"formfactors", file, "-o", folder.file("g.npy"), "-o", folder.file("g.mtx")});
  ASSERT_EQ(kept.status, 0) << kept.err;
  const std::string npy = content_of(folder.file("f.npy")), mtx = content_of(folder.file("f.mtx"));
  EXPECT_TRUE(npy == content_of(folder.file("g.npy")));
  EXPECT_TRUE(mtx == content_of(folder.file("g.mtx")));
  EXPECT_THAT(npy, HasSubstr("'descr': '<f4', 'fortran_order': False, 'shape': (820, 820)"));
  EXPECT_EQ(npy.find('\n') % 64, 63U);
  const std::vector<float> f = npy_values(npy);
  ASSERT_EQ(f.size(), 820U * 820U);

  std::istringstream lines(mtx);
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ(line, "%%MatrixMarket matrix coordinate real general");
  std::getline(lines, line);
  EXPECT_THAT(line, HasSubstr("% form factors F(i, j)"));
  std::size_t rows = 0, columns = 0, count = 0, read = 0, i = 0, j = 0;
  lines >> rows >> columns >> count;
  EXPECT_EQ(rows, 820U);
  EXPECT_EQ(columns, 820U);
  std::vector<float> g(f.size());
  for (std::string value; lines >> i >> j >> value; ++read) g.at((i - 1) * 820 + j - 1) = std::stof(value);
  EXPECT_EQ(read, count);
  EXPECT_EQ(f, g);
  // Its rows sum to what the report says.
  const json closure = report(run_program({"formfactors", file, "--json"}))["closure"];
  double largest = 0;
  for (std::size_t row = 0; row < 820; ++row) {
    double sum = 0;
    for (std::size_t k = 0; k < 820; ++k) sum += static_cast<double>(f[row * 820 + k]);
    largest = std::max(largest, sum);
  }
  EXPECT_NEAR(largest, double{closure["max"]}, 1e-6);
  // Python reads the header as NumPy does; NumPy itself where it is installed.
  const std::string reads =
      "import ast, os, struct, sys\n"
      "file = open(sys.argv[1], 'rb')\n"
      "assert file.read(8) == b'\\x93NUMPY\\x01\\x00'\n"
      "header = ast.literal_eval(file.read(struct.unpack('<H', file.read(2))[0]).decode('latin1'))\n"
      "assert header == {'descr': '<f4', 'fortran_order': False, 'shape': (820, 820)}, header\n"
      "assert os.path.getsize(sys.argv[1]) - file.tell() == 4 * 820 * 820\n"
      "try:\n    import numpy\nexcept ImportError:\n    sys.exit(0)\n"
      "f = numpy.load(sys.argv[1])\n"
      "assert f.shape == (820, 820) and f.dtype == numpy.float32\n";
  const std::string command = "python3 " + folder.write("read.py", reads) + " " + folder.file("f.npy");
  EXPECT_EQ(std::system(command.c_str()), 0);  // NOLINT: names of our own
}

TEST_F(KeptBox, WrongOutputsAreUsageErrors) {
  for (const std::vector<std::string>& more :
       std::vector<std::vector<std::string>>{{"-o", folder.file("f.txt")},
                                             {"-o", folder.file("a.iff"), "-o", folder.file("b.iff")},
                                             {"-o", folder.file("f.npy"), "-o", folder.file("f.npy")},
                                             {"-o", scene_file("cornell-box.obj")},
                                             {"--accuracy", "best"},
                                             {"--seed", "-1"},
                                             {"--repair"}}) {
    const Outcome outcome = run_program(arguments(more));
    EXPECT_EQ(outcome.status, 2) << outcome.err;
    EXPECT_EQ(outcome.error_lines().size(), 1U);
  }
  EXPECT_EQ(solve({"-o", file}).status, 2);
  EXPECT_TRUE(content_of(file) == bytes);
}

}  // namespace
}  // namespace interflect::test
