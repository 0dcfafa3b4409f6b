// Progress for people and programs, and Ctrl-C in a solve.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>

#include "program.h"
#include "progress_line.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// The program with its stderr held by the test, as a pipe or a terminal of 100 columns.
class Watched {
 public:
  enum class Stderr { pipe, terminal };

  Watched(std::vector<std::string> arguments, Stderr kind) {
    arguments.insert(arguments.begin(), INTERFLECT_PROGRAM);
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    int theirs = -1;
    if (kind == Stderr::pipe) {
      std::array<int, 2> ends{};
      EXPECT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
      ours_ = ends[0], theirs = ends[1];
    } else {
      ours_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
      EXPECT_TRUE(ours_ >= 0 && ::grantpt(ours_) == 0 && ::unlockpt(ours_) == 0);
      theirs = ::open(::ptsname(ours_), O_RDWR | O_NOCTTY | O_CLOEXEC);  // NOLINT: one thread
      struct winsize size {};
      size.ws_col = 100, size.ws_row = 24;
      ::ioctl(theirs, TIOCSWINSZ, &size);
    }
    const int null = ::open("/dev/null", O_RDWR | O_CLOEXEC);
    std::string threads = "OMP_WAIT_POLICY=passive";
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(null, 0);
      ::dup2(null, 1);
      ::dup2(theirs, 2);
      ::putenv(threads.data());
      ::execv(argv[0], argv.data());
      ::_exit(99);
    }
    ::close(null);
    ::close(theirs);
  }
  Watched(const Watched&) = delete;
  Watched& operator=(const Watched&) = delete;
  ~Watched() {
    if (pid_ > 0) ::kill(pid_, SIGKILL), (void)wait();
    ::close(ours_);
  }

  void interrupt() const { ::kill(pid_, SIGINT); }

  /// Reads to the end; gives every whole line to `see`.
  void read(const std::function<void(const std::string&)>& see = {}) {
    std::array<char, 4096> chunk{};
    for (;;) {
      const ssize_t got = ::read(ours_, chunk.data(), chunk.size());
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return;  // a terminal that nobody holds any more is an error (EIO)
      text_.append(chunk.data(), static_cast<std::size_t>(got));
      for (auto end = text_.find('\n', seen_); end != std::string::npos; end = text_.find('\n', seen_)) {
        const std::string line = text_.substr(seen_, end - seen_);
        seen_ = end + 1;
        if (see) see(line);
      }
    }
  }
  [[nodiscard]] const std::string& text() const { return text_; }

  /// The exit status; 128 + signal when one ended it.
  int wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    killed_ = WIFSIGNALED(status);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  [[nodiscard]] bool killed() const { return killed_; }

 private:
  int ours_ = -1;
  pid_t pid_ = -1;
  bool killed_ = false;
  std::string text_;
  std::size_t seen_ = 0;
};

/// The Cornell box with its form factors kept, so that a solve begins at once.
class Progress : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<Folder>();
    const Outcome made =
        run_program({"formfactors", scene_file("cornell-box.obj"), "--divide", "4000", "-o", factors()});
    ASSERT_EQ(made.status, 0) << made.err;
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static std::string factors() { return folder_->file("box.iff"); }

  /// A solve that goes on until it is told to stop: an iteration is a bounce.
  static std::vector<std::string> endless(const Folder& folder) {
    return {"solve",
            scene_file("cornell-box.obj"),
            "--form-factors",
            factors(),
            "--method",
            "jacobi",
            "--iterations",
            "10000000",
            "-o",
            folder.file("box.png"),
            "-o",
            folder.file("box.npy"),
            "--size",
            "64x64",
            "--report",
            folder.file("box.json"),
            "--json-progress"};
  }
  static std::unique_ptr<Folder> folder_;
};
std::unique_ptr<Folder> Progress::folder_;

TEST_F(Progress, CtrlCInTheSolveLeavesTheBestSoFar) {
  std::mt19937 random(7);  // NOLINT: the same iterations every time
  for (int run = 0; run < 3; ++run) {
    const Folder folder;
    const auto when = std::uniform_int_distribution<std::uint32_t>(1, 20)(random);
    Watched program(endless(folder), Watched::Stderr::pipe);
    double residual = 0;
    bool sent = false;
    program.read([&](const std::string& line) {
      const json object = json::parse(line);
      if (!object.contains("iteration") || object["iteration"] < when || sent) return;
      residual = object["residual"];
      program.interrupt();
      sent = true;
    });
    EXPECT_EQ(program.wait(), 130) << program.text();
    EXPECT_FALSE(program.killed());
    EXPECT_THAT(folder.names(), ElementsAre("box.json", "box.npy", "box.png"));
    EXPECT_EQ(content_of(folder.file("box.png")).substr(1, 3), "PNG");
    const json report = json::parse(content_of(folder.file("box.json")));
    EXPECT_EQ(report["interrupted"], true);
    EXPECT_GE(report["iterations"], when);
    EXPECT_LT(report["iterations"], 10'000'000);
    for (const double r : report["relative_residual"]) EXPECT_LE(r, std::max(1.05 * residual, 1e-6)) << when;
    EXPECT_THAT(program.text(), HasSubstr(R"("kind":"interrupted","status":130)"));
    EXPECT_THAT(program.text(), HasSubstr("best so far"));
  }
}

TEST_F(Progress, WithoutCtrlCTheSameSolveEndsWell) {
  const Folder folder;
  std::vector<std::string> arguments = endless(folder);
  arguments[7] = "20";
  const Outcome outcome = run_program(arguments);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(json::parse(content_of(folder.file("box.json")))["interrupted"], false);
  EXPECT_THAT(outcome.err, Not(HasSubstr("interrupted")));
}

TEST_F(Progress, CtrlCBeforeTheFirstIterationWritesNothing) {
  const Folder folder;
  std::vector<std::string> arguments = endless(folder);
  arguments.erase(arguments.begin() + 2, arguments.begin() + 4);  // computes the form factors
  Watched program(arguments, Watched::Stderr::pipe);
  program.read([&](const std::string& line) {
    if (json::parse(line)["stage"] == "form factors") program.interrupt();
  });
  EXPECT_EQ(program.wait(), 130);
  EXPECT_TRUE(program.killed());
  EXPECT_THAT(folder.names(), ElementsAre());
}

TEST_F(Progress, ASecondCtrlCEndsAtOnce) {
  const Folder folder;
  std::vector<std::string> arguments = endless(folder);
  for (std::string& argument : arguments) {
    if (argument == "64x64") argument = "2000x2000";
  }
  arguments.insert(arguments.end(), {"--samples", "4096"});  // a picture that takes minutes
  Watched program(arguments, Watched::Stderr::pipe);
  bool first = false, second = false;
  program.read([&](const std::string& line) {
    const json object = json::parse(line);
    if (object.contains("iteration") && !first) program.interrupt(), first = true;
    if (object.value("stage", "") == "Picture" && !second) program.interrupt(), second = true;
  });
  EXPECT_EQ(program.wait(), 130);
  EXPECT_TRUE(program.killed());
  EXPECT_THAT(folder.names(), ElementsAre());
}

TEST_F(Progress, CtrlCInAFilmFinishesTheFrameAndSaysHowToGoOn) {
  const Folder folder, frames;
  ASSERT_EQ(run_program({"solve", scene_file("furnace.obj"), "--divide", "0.1", "-o", folder.file("cube.glb")}).status,
            0);
  Watched program({"render", folder.file("cube.glb"), "--orbit", "--frames", "1000000", "--size", "16x16", "-o",
                   frames.file("%d.png"), "--json-progress"},
                  Watched::Stderr::pipe);
  bool sent = false;
  program.read([&](const std::string& line) {
    const json object = json::parse(line);
    if (sent || object.value("stage", "") != "Frames" || object["done"] < 2) return;
    program.interrupt();
    sent = true;
  });
  EXPECT_EQ(program.wait(), 130);
  EXPECT_FALSE(program.killed());
  const std::size_t made = frames.names().size();  // whole frames and nothing else
  EXPECT_GE(made, 2U);
  EXPECT_LT(made, 1000000U);
  for (std::size_t k = 0; k < made; ++k)
    EXPECT_EQ(content_of(frames.file(std::to_string(k) + ".png")).substr(1, 3), "PNG");
  EXPECT_THAT(program.text(), HasSubstr("--first " + std::to_string(made) + " goes on"));
}

TEST_F(Progress, JsonIsOneObjectPerLine) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("cornell-box.obj"), "--divide", "4000", "-o", folder.file("box.png"), "--size",
                   "96x96", "--report", folder.file("box.json"), "--json-progress"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  std::set<std::string> begun, ended;
  std::uint32_t iteration = 0;
  std::istringstream lines(outcome.err);
  for (std::string line; std::getline(lines, line);) {
    const json object = json::parse(line);  // throws where it is none
    ASSERT_TRUE(object.is_object());
    if (object.contains("message")) continue;
    const std::string stage = object["stage"], state = object["state"];
    if (state == "begin") begun.insert(stage);
    if (state == "end") ended.insert(stage);
    EXPECT_TRUE(begun.contains(stage)) << line;
    if (object["total"] > 0) {
      EXPECT_LE(object["done"], object["total"]);
      EXPECT_TRUE(state != "end" || stage == "Solve" || object["done"] == object["total"]) << line;
    }
    EXPECT_GE(object["rate"], 0);
    EXPECT_TRUE(object["seconds_left"].is_null() || object["seconds_left"] >= 0);
    if (!object.contains("iteration") || state != "running") continue;
    EXPECT_EQ(object["iteration"], iteration + 1) << "each iteration is told";
    iteration = object["iteration"];
    EXPECT_GT(object["residual"], 0);
  }
  EXPECT_EQ(begun, (std::set<std::string>{"Read", "Mesh", "form factors", "closure", "Solve", "Picture", "Write"}));
  EXPECT_EQ(begun, ended);
  EXPECT_EQ(json::parse(content_of(folder.file("box.json")))["iterations"], iteration);
}

TEST_F(Progress, ErrorsAreObjectsToo) {
  const Outcome outcome = run_program({"solve", "nowhere.obj", "--json-progress"});
  EXPECT_EQ(outcome.status, 3);
  std::istringstream lines(outcome.err);
  json last;
  for (std::string line; std::getline(lines, line);) last = json::parse(line);
  EXPECT_EQ(last["status"], 3);
  EXPECT_EQ(last["kind"], "input");
  EXPECT_THAT(last["error"], HasSubstr("nowhere.obj"));
}

TEST_F(Progress, ATerminalGetsBarsAndAPipeNone) {
  const Folder folder;
  const std::vector<std::string> arguments{"solve", scene_file("cornell-box.obj"), "--divide", "4000",
                                           "-o",    folder.file("box.png"),        "--size",   "96x96"};
  Watched terminal(arguments, Watched::Stderr::terminal);
  terminal.read();
  EXPECT_EQ(terminal.wait(), 0) << terminal.text();
  const std::string& text = terminal.text();
  for (const char* part : {"form factors   [", "tiles/s", " left", "Solve          [", "iteration 1, residual ",
                           " it/s", "Picture        [", "rows/s", "Write          ["}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  // Every bar is drawn over the one before, and the last is wiped away.
  EXPECT_TRUE(text.ends_with("\r\x1b[K")) << text.substr(text.size() - 20);
  std::istringstream drawn(text);
  for (std::string bar; std::getline(drawn, bar, '\r');) {
    const bool message = bar.find("interflect: ") != std::string::npos;
    EXPECT_TRUE(message || bar.size() < 100 + 3) << bar;  // with the three characters that wipe
  }

  Watched pipe(arguments, Watched::Stderr::pipe);
  pipe.read();
  EXPECT_EQ(pipe.wait(), 0);
  EXPECT_THAT(pipe.text(), HasSubstr("warning: "));
  EXPECT_THAT(pipe.text(), Not(HasSubstr("\r")));
  EXPECT_THAT(pipe.text(), Not(HasSubstr(" rows/s")));
}

TEST(ProgressLine, SaysRateAndTimeLeft) {
  cli::StageState state{"form factors", 250, 1000, 2};
  EXPECT_EQ(cli::bar_line(state, 79), "form factors   [#####...............]  25 %  125 tiles/s  6.0 s left");
  EXPECT_EQ(cli::bar_line(state, 20), "form factors   [#...");
  state = {"Frames", 90'000, 100'000, 8000};
  EXPECT_THAT(cli::bar_line(state, 79), HasSubstr("11.2 frames/s  14 min 48 s left"));
  state = {"Read", 0, 0, 3};
  EXPECT_EQ(cli::bar_line(state, 79), "Read           3.0 s");
  state = {"Solve", 50, 100, 4, 8, 1e-3};
  EXPECT_EQ(cli::bar_line(state, 99),
            "Solve          [##########..........]  50 %  iteration 8, residual 1.0e-03  2 it/s  4.0 s left");
  EXPECT_EQ(cli::bar_line(state, 79),
            "Solve          [##...]  50 %  iteration 8, residual 1.0e-03  2 it/s  4.0 s left");
}

}  // namespace
}  // namespace interflect::test
