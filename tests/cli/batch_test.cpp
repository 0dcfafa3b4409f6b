// Several scenes in one run: what fails, what is skipped, what is refused before any work.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "device_pool.h"
#include "interflect/device/registry.h"
#include "program.h"

namespace interflect {
namespace {

using namespace test;
using cli::DevicePool;
using nlohmann::json;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

struct Scenes {
  Folder folder;
  std::string furnace = copy("furnace.obj", "furnace.mtl");
  std::string plates = copy("two-plates.obj", "two-plates.mtl");

  [[nodiscard]] std::string copy(const std::string& scene, const std::string& materials) const {
    static_cast<void>(folder.write(materials, content_of(scene_file(materials))));
    return folder.write(scene, content_of(scene_file(scene)));
  }
  /// solve with a coarse mesh, and one line per job of what came of it.
  [[nodiscard]] Outcome solve(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "solve");
    arguments.insert(arguments.end(), {"--summary", folder.file("summary.json")});
    return run_program(arguments);
  }
  [[nodiscard]] std::vector<std::string> results() const {
    std::vector<std::string> out;
    const json summary = json::parse(content_of(folder.file("summary.json")));
    for (const json& job : summary["jobs"]) {
      out.push_back(job["result"].get<std::string>());
    }
    return out;
  }
  /// All jobs of a furnace and plates with a missing scene in the middle, into NAME.csv.
  [[nodiscard]] std::vector<std::string> three(std::vector<std::string> more = {}) const {
    std::vector<std::string> all{furnace, folder.file("missing.obj"), plates, "--divide", "0.5",
                                 "-o",    "{folder}/{name}.csv"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
};

TEST(BatchTest, OneThatFailsDoesNotEndTheOthersAndARerunSkipsWhatIsDone) {
  const Scenes s;
  const Outcome first = s.solve(s.three());
  EXPECT_EQ(first.status, 3);  // the first failing job's
  EXPECT_THAT(s.results(), ElementsAre("done", "failed", "done"));
  EXPECT_THAT(first.out, HasSubstr("3 jobs: 2 done, 1 failed"));
  EXPECT_THAT(first.error_lines(), ElementsAre(HasSubstr("job 2 of 3")));
  const std::string furnace = content_of(s.folder.file("furnace.csv"));
  EXPECT_EQ(run_program({"solve", s.furnace, "--divide", "0.5", "-o", s.folder.file("alone.csv")}).status, 0);
  EXPECT_EQ(furnace, content_of(s.folder.file("alone.csv")));  // the same as on its own
  EXPECT_THAT(content_of(s.folder.file("two-plates.csv")), Not(IsEmpty()));

  EXPECT_EQ(s.solve(s.three()).status, 3);
  EXPECT_THAT(s.results(), ElementsAre("skipped", "failed", "skipped"));
  EXPECT_EQ(s.solve(s.three({"--force"})).status, 3);
  EXPECT_THAT(s.results(), ElementsAre("done", "failed", "done"));
}

TEST(BatchTest, WhatChangesIsSolvedAgain) {
  const Scenes s;
  EXPECT_EQ(s.solve(s.three()).status, 3);
  const auto rerun = [&](const std::vector<std::string>& more = {}) {
    static_cast<void>(s.solve(s.three(more)));
    return s.results()[0];
  };
  EXPECT_EQ(rerun(), "skipped");
  EXPECT_EQ(rerun({"--tol", "1e-5"}), "done");  // other options
  EXPECT_EQ(rerun(), "done");
  EXPECT_EQ(rerun(), "skipped");
  EXPECT_EQ(rerun({"--checkpoint", s.folder.file("{name}.ckp")}), "skipped");  // this changes no result
  const std::string materials = content_of(s.folder.file("furnace.mtl"));
  const auto time = std::filesystem::last_write_time(s.folder.file("furnace.mtl"));
  std::string other = materials;
  other.replace(other.find("0.25"), 4, "0.35");
  static_cast<void>(s.folder.write("furnace.mtl", other));
  std::filesystem::last_write_time(s.folder.file("furnace.mtl"), time);
  EXPECT_EQ(rerun(), "done");  // other materials, of the same time and size
  static_cast<void>(s.folder.write("furnace.mtl", materials));
  EXPECT_EQ(rerun(), "done");
  std::filesystem::last_write_time(s.furnace, time + std::chrono::hours(1));
  EXPECT_EQ(rerun(), "skipped");  // only newer
  static_cast<void>(s.folder.write("furnace.csv", "not ours\n"));
  EXPECT_EQ(rerun(), "done");  // another result
  std::filesystem::remove(s.folder.file("furnace.csv"));
  EXPECT_EQ(rerun(), "done");
  static_cast<void>(s.folder.write("furnace.csv.done", "{"));
  EXPECT_EQ(rerun(), "done");  // a damaged note is not trusted
  EXPECT_EQ(s.results()[2], "skipped");
}

TEST(BatchTest, TheSameFileTwiceIsRefusedBeforeAnyWork) {
  const Scenes s;
  const auto refused = [&](const std::vector<std::string>& arguments) {
    const Outcome outcome = s.solve(arguments);
    EXPECT_EQ(outcome.status, 2);
    EXPECT_THAT(outcome.error_lines(), SizeIs(1));
    EXPECT_EQ(std::filesystem::exists(s.folder.file("summary.json")), false);
    return outcome.err;
  };
  EXPECT_THAT(refused({s.furnace, s.plates, "-o", s.folder.file("a.csv")}), HasSubstr("written by job 1"));
  EXPECT_THAT(refused({s.furnace, s.furnace, "-o", "{folder}/{name}.csv"}), HasSubstr("written by job 1"));
  EXPECT_THAT(refused({s.furnace, s.plates, "--checkpoint", s.folder.file("a.ckp")}), HasSubstr("written by job 1"));
  EXPECT_THAT(refused({s.furnace, s.plates, "-o", "{folder}/{name}.bmp"}), HasSubstr("not an output format"));
  EXPECT_THAT(refused({s.furnace, s.plates, "--report", "{folder}/{name}.obj"}), HasSubstr("is the scene"));
  EXPECT_THAT(refused({s.furnace, s.folder.file("furnace.glb"), "-o", "{folder}/{name}.glb"}), HasSubstr("destroy it"));
  EXPECT_THAT(refused({s.furnace, s.folder.file("x.glb"), "-o", s.folder.file("{name}-1.glb"), "-o",
                       s.folder.file("../x/{name}.csv"), "--report", s.folder.file("summary.json")}),
              HasSubstr("written by job 1"));
  EXPECT_THAT(s.folder.names(), ElementsAre("furnace.mtl", "furnace.obj", "two-plates.mtl", "two-plates.obj"));
}

TEST(BatchTest, AManifestHasOptionsForEachJob) {
  const Scenes s;
  const std::string manifest = s.folder.write(
      "jobs.json",
      json{{"defaults", {{"divide", 0.5}, {"method", "jacobi"}}},
           {"jobs",
            {{{"scene", s.furnace}, {"output", s.folder.file("a.csv")}, {"report", s.folder.file("a.json")}},
             {{"scene", s.furnace},
              {"output", {s.folder.file("b.csv"), s.folder.file("b.npy")}},
              {"report", s.folder.file("b.json")},
              {"method", "cg"},
              {"patches", 100},
              {"two-sided", true},
              {"tol", 1e-4}}}}}
          .dump());
  EXPECT_EQ(s.solve({"--manifest", manifest, "--tol", "1e-5"}).status, 0);
  EXPECT_THAT(s.results(), ElementsAre("done", "done"));
  const json a = json::parse(content_of(s.folder.file("a.json"))), b = json::parse(content_of(s.folder.file("b.json")));
  EXPECT_EQ(a["method"], "jacobi");
  EXPECT_EQ(a["divide"], 0.5);
  EXPECT_EQ(a["tolerance"], 1e-5);  // the command line's
  EXPECT_EQ(b["method"], "cg");
  EXPECT_NE(b["divide"], 0.5);  // --patches of its own excludes the default
  EXPECT_EQ(b["tolerance"], 1e-4);
  EXPECT_EQ(b["patches"], 96);  // on both sides of 12 triangles in four
  EXPECT_THAT(s.folder.names(), Contains("b.npy"));
  EXPECT_EQ(s.solve({"--manifest", manifest, "--tol", "1e-5"}).status, 0);
  EXPECT_THAT(s.results(), ElementsAre("skipped", "skipped"));
}

TEST(BatchTest, AManifestThatIsWrongIsNamedWithItsJob) {
  const Scenes s;
  const auto said = [&](const std::string& text, int status = 3) {
    const std::string file = s.folder.write("jobs.json", text);
    const Outcome outcome = s.solve({"--manifest", file});
    EXPECT_EQ(outcome.status, status) << text << outcome.err;
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("jobs.json"))) << outcome.err;
    EXPECT_THAT(outcome.out, IsEmpty());
    return outcome.err;
  };
  const std::string scene = json(s.furnace).dump();
  const auto job = [&](const std::string& more) { return R"({"jobs": [{"scene": )" + scene + more + "}]}"; };
  EXPECT_THAT(said("{"), HasSubstr("is not JSON: parse error at line 1"));
  EXPECT_THAT(said("[]"), HasSubstr("is a list, and an object"));
  EXPECT_THAT(said("{}"), HasSubstr("has no 'jobs'"));
  EXPECT_THAT(said(R"({"jobs": []})"), HasSubstr("'jobs' is an empty list"));
  EXPECT_THAT(said(R"({"jobs": {}})"), HasSubstr("'jobs' is an object"));
  EXPECT_THAT(said(R"({"jobs": [1]})"), HasSubstr("job 1: is a number"));
  EXPECT_THAT(said(R"({"jobs": [{}]})"), HasSubstr("job 1: has no 'scene'"));
  EXPECT_THAT(said(R"({"jobs": [{"scene": 3}]})"), HasSubstr("job 1: 'scene' is not the name"));
  EXPECT_THAT(said(R"({"job": 1, "jobs": []})"), HasSubstr("'job' is neither"));
  EXPECT_THAT(said(R"({"defaults": {"scene": "a"}, "jobs": [{"scene": "a"}]})"),
              HasSubstr("defaults: 'scene' is not an option"));
  EXPECT_THAT(said(job(R"(, "tolerance": 1)")), HasSubstr("'tolerance' is not an option of solve"));
  EXPECT_THAT(said(job(R"(, "tol": {})")), HasSubstr("'tol' is an object"));
  EXPECT_THAT(said(job(R"(, "tol": "x")")), HasSubstr("--tol"));
  EXPECT_THAT(said(job(R"(, "tol": [1e-3])")), HasSubstr("'tol' is a list"));
  EXPECT_THAT(said(job(R"(, "two-sided": 1)")), HasSubstr("true or false is wanted"));
  EXPECT_THAT(said(job(R"(, "two-sided": false, "tol": "x")")), HasSubstr("--tol"));  // false is none of the scenes
  EXPECT_THAT(said(job(R"(, "output": [])")), HasSubstr("'output' is an empty list"));
  EXPECT_THAT(said(job(R"(, "output": null)")), HasSubstr("'output' is null"));
  EXPECT_THAT(said(job(R"(, "tol": 1e-3, "tol": 1e-4)")), HasSubstr("'tol' comes twice"));
  EXPECT_THAT(said(job(R"(, "quiet": true)")), HasSubstr("'quiet' is for the whole run"));
  EXPECT_THAT(said(job(R"(, "manifest": "jobs.json")")), HasSubstr("'manifest' is not an option"));
  EXPECT_THAT(said(job(R"(, "divide": 1, "patches": 10)")), HasSubstr("excludes"));
  EXPECT_THAT(said(job(R"(, "output": "a.bmp")"), 2), HasSubstr("not an output format"));
  // Each reads what the other writes.
  const std::string a = json(s.folder.file("a.glb")).dump(), b = json(s.folder.file("b.glb")).dump();
  EXPECT_THAT(
      said(fmt::format(R"({{"jobs": [{{"scene": {0}, "output": {1}}}, {{"scene": {1}, "output": {0}}}]}})", a, b), 2),
      HasSubstr("jobs must not depend on each other"));
  EXPECT_THAT(said(job(R"(, "report": )" + json(s.folder.file("jobs.json")).dump()), 2), HasSubstr("the run itself"));
}

TEST(BatchTest, UnconvergedIsNotDone) {
  const Scenes s;
  const std::vector<std::string> arguments{s.furnace,  s.plates, "--divide",         "0.5", "-o", "{folder}/{name}.csv",
                                           "--method", "jacobi", "--max-iterations", "2"};
  for (int run = 0; run < 2; ++run) {
    EXPECT_EQ(s.solve(arguments).status, 5);
    EXPECT_EQ(s.results()[0], "not converged");
    EXPECT_THAT(s.folder.names(), Contains("furnace.csv"));
  }
}

/// A run that is interrupted once its stderr has a text.
struct Interrupted {
  Interrupted(std::vector<std::string> words, const std::string& at) {
    words.insert(words.begin(), {"interflect", "solve", "--json-progress"});
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    const std::string out_file = output.file("out"), err_file = output.file("err");
    const pid_t child = ::fork();
    if (child == 0) {
      const bool open = ::freopen(out_file.c_str(), "w", stdout) != nullptr &&  //
                        ::freopen(err_file.c_str(), "w", stderr) != nullptr;
      if (open) ::execv(INTERFLECT_PROGRAM, arguments.data());
      ::_exit(127);
    }
    while (content_of(err_file).find(at) == std::string::npos) {
      if (::waitpid(child, &status, WNOHANG) != 0) {
        ADD_FAILURE() << "ended too early: " << content_of(err_file);
        return;
      }
      ::usleep(1000);
    }
    ::kill(child, SIGINT);
    ::waitpid(child, &status, 0);
    out = content_of(out_file);
    err = content_of(err_file);
  }
  Folder output;
  int status = 0;
  std::string out, err;
};

TEST(BatchTest, CtrlCEndsTheJobInHandAndLeavesTheOthers) {
  const Scenes s;
  const Interrupted run({s.furnace, s.plates, "--divide", "0.5", "--method", "jacobi", "--iterations", "10000000", "-o",
                         s.folder.file("{name}.csv"), "--summary", s.folder.file("summary.json")},
                        "\"iteration\"");
  ASSERT_TRUE(WIFEXITED(run.status));
  EXPECT_EQ(WEXITSTATUS(run.status), 130);
  EXPECT_THAT(s.results(), ElementsAre("interrupted", "not done"));
  EXPECT_THAT(run.out, HasSubstr("2 jobs: 1 interrupted, 1 not done"));
  EXPECT_THAT(run.err, HasSubstr("\"job\":1,\"jobs\":2"));
  EXPECT_THAT(s.folder.names(), Contains("furnace.csv"));  // as a solve alone: the best so far
  EXPECT_THAT(s.folder.names(), Not(Contains("furnace.csv.done")));
}

TEST(BatchTest, CtrlCBeforeTheSolverSaysWhatIsNotDone) {
  const Scenes s;
  const Interrupted run({scene_file("room-9680.obj"), s.plates, "--patches", "30000", "-o", s.folder.file("{name}.csv"),
                         "--summary", s.folder.file("summary.json")},
                        "\"form factors\"");
  EXPECT_TRUE(WIFSIGNALED(run.status) && WTERMSIG(run.status) == SIGINT);  // at once
  EXPECT_THAT(run.err, HasSubstr("interrupted in job 1 of 2"));
  EXPECT_THAT(run.err, HasSubstr("it and the 1 after it are not done"));
  EXPECT_THAT(s.results(), ElementsAre("not done", "not done"));
}

TEST(BatchTest, OneSceneIsASolveAsEver) {
  const Scenes s;
  const Outcome one = run_program({"solve", s.furnace, "--divide", "0.5", "-o", "{folder}/{name}-lit.csv"});
  EXPECT_EQ(one.status, 0);
  EXPECT_THAT(one.out, HasSubstr("converged"));
  EXPECT_THAT(s.folder.names(), Contains("furnace-lit.csv"));
  EXPECT_THAT(s.folder.names(), Not(Contains("furnace-lit.csv.done")));
  EXPECT_EQ(run_program({"solve"}).status, 2);
  EXPECT_EQ(run_program({"solve", s.furnace, "--force"}).status, 2);
  EXPECT_EQ(run_program({"solve", s.furnace, "--manifest", "x.json"}).status, 2);
}

/// A device that counts, and fails when it is told to.
struct Told {
  int opened = 0, compiled = 0;
  bool fails = false;
};
class ToldDevice final : public Device {
 public:
  explicit ToldDevice(Told& told) : told_(told), inner_(open_device("openmp")) { ++told.opened; }
  [[nodiscard]] const DeviceInfo& info() const override { return inner_->info(); }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override {
    if (told_.fails) throw device_error("told", "allocate", "as told");
    return inner_->allocate(bytes);
  }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return inner_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    ++told_.compiled;
    return inner_->kernel(name, macros);
  }
  [[nodiscard]] Queue& queue() override { return inner_->queue(); }

 private:
  Told& told_;
  std::unique_ptr<Device> inner_;
};

TEST(DevicePoolTest, OpensAndCompilesOnceAndDropsWhatFailed) {
  Told told;
  int chosen = 0;
  DevicePool pool([&](const std::string&) { return std::make_unique<ToldDevice>(told); },
                  [&](const std::string& text) {
                    ++chosen;
                    return std::vector<std::string>{text};
                  });
  FormFactorMatrix f(2);
  f.row(0)[1] = f.row(1)[0] = 1.0F;
  const std::vector<double> area{1, 1};
  const Columns rho{{0.5F, 0.5F}}, e{{1.0F, 1.0F}};
  ProgressSink sink;
  const auto solve = [&] {
    Candidates candidates = pool.candidates("told", sink);
    Columns b;
    EXPECT_TRUE(solve_on(candidates, f, Method::cg, {}, area, rho, e, b).report.converged);
    EXPECT_NEAR(b.at(0).at(1), 2.0F, 1e-5F);  // 1 + 1/2 + 1/4 ...
  };
  solve();
  const int compiled = told.compiled;
  EXPECT_GT(compiled, 0);
  solve();
  EXPECT_EQ(told.opened, 1);
  EXPECT_EQ(told.compiled, compiled);
  EXPECT_EQ(chosen, 1);
  told.fails = true;
  Candidates failing = pool.candidates("told", sink);
  Columns b;
  EXPECT_THROW(static_cast<void>(solve_on(failing, f, Method::cg, {}, area, rho, e, b)), Error);
  told.fails = false;
  solve();  // on a fresh one
  EXPECT_EQ(told.opened, 2);
}

}  // namespace
}  // namespace interflect
