#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program.h"

// interflect tune, and what solve makes of it. The program finds OpenMP only here; nothing is asserted of times.

namespace interflect::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

class TuneCommand : public testing::Test {
 protected:
  [[nodiscard]] Outcome run(std::vector<std::string> arguments,
                            const std::string& more = "INTERFLECT_TUNING=on") const {
    return run_program(arguments, {"INTERFLECT_TUNING=on", "XDG_CACHE_HOME=" + cache.file("xdg"), more});
  }
  [[nodiscard]] Outcome tune(std::vector<std::string> arguments = {"--device", "openmp", "--seconds", "0.01"}) const {
    arguments.insert(arguments.begin(), "tune");
    return run(std::move(arguments));
  }
  [[nodiscard]] std::vector<fs::path> entries() const {
    std::vector<fs::path> all;
    const fs::path folder = fs::path(cache.file("xdg")) / "interflect" / "tuning";
    if (!fs::exists(folder)) return all;
    for (const auto& entry : fs::directory_iterator(folder)) all.push_back(entry.path());
    return all;
  }
  Folder cache;
};

TEST_F(TuneCommand, SearchesKeepsListsAndClears) {
  const Outcome first = tune();
  EXPECT_EQ(first.status, 0) << first.err;
  EXPECT_THAT(first.out, HasSubstr("tiles16"));
  EXPECT_THAT(first.out, HasSubstr("BLOCK=1024 PREFETCH=160"));
  EXPECT_THAT(first.err, IsEmpty());
  EXPECT_THAT(entries(), SizeIs(2));
  EXPECT_THAT(tune({"--list"}).out, HasSubstr("sym16"));
  const auto list = nlohmann::json::parse(tune({"--list", "--json"}).out);
  ASSERT_THAT(list, SizeIs(2));
  for (const auto& entry : list) {
    EXPECT_EQ(entry.at("backend"), "openmp");
    EXPECT_TRUE(entry.at("default").contains("PREFETCH"));
    EXPECT_TRUE(entry.at("chosen").contains("PREFETCH"));
    EXPECT_TRUE(fs::exists(entry.at("file").get<std::string>()));
  }
  EXPECT_THAT(nlohmann::json::parse(tune({"--list", "--json", "--device", "openmp"}).out), SizeIs(2));
  EXPECT_EQ(tune({"--clear", "--device", "openmp"}).out, "2 entries removed\n");
  EXPECT_THAT(entries(), IsEmpty());
  EXPECT_EQ(tune({"--list", "--json"}).out, "[]\n");
  EXPECT_EQ(tune({"--clear"}).out, "0 entries removed\n");
}

TEST_F(TuneCommand, ClearRemovesDamageToo) {
  fs::create_directories(fs::path(cache.file("xdg")) / "interflect" / "tuning");
  std::ofstream(fs::path(cache.file("xdg")) / "interflect" / "tuning" / "openmp-sym16-1") << "";
  EXPECT_EQ(tune({"--list", "--json"}).out, "[]\n");
  EXPECT_EQ(tune({"--clear", "--device", "openmp"}).out, "0 entries removed\n");
  EXPECT_EQ(tune({"--clear"}).out, "1 entry removed\n");
}

TEST_F(TuneCommand, WrongUseIsRefused) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"--device", "vulkan:99"},
                                             {"--list", "--device", "nothing"},
                                             {"--clear", "--device", ""},
                                             {"--seconds", "0"},
                                             {"--seconds", "nan"},
                                             {"--seconds", "-1"},
                                             {"--json"},
                                             {"--list", "--clear"},
                                             {"--clear", "--seconds", "1"},
                                             {"extra"}}) {
    const Outcome outcome = tune(arguments);
    EXPECT_EQ(outcome.status, 2) << arguments.front();
    EXPECT_THAT(outcome.error_lines(), SizeIs(1)) << arguments.front();
  }
  const Outcome off = run({"tune"}, "INTERFLECT_TUNING=off");
  EXPECT_EQ(off.status, 2);
  EXPECT_THAT(off.err, HasSubstr("INTERFLECT_TUNING"));
}

TEST_F(TuneCommand, WithoutAPlaceItSaysSo) {
  const std::string file = cache.write("file", "not a folder");
  const Outcome outcome = run({"tune", "--device", "openmp", "--seconds", "0.01"}, "XDG_CACHE_HOME=" + file);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("sym16"));
  EXPECT_THAT(outcome.err, HasSubstr("warning: openmp sym16 is not kept: "));
  const Outcome off = run({"tune", "--device", "openmp", "--seconds", "0.01"}, "INTERFLECT_CACHE=off");
  EXPECT_EQ(off.status, 0);
  EXPECT_THAT(off.err, HasSubstr("is not kept"));
  EXPECT_THAT(entries(), IsEmpty());
}

std::vector<double> numbers_of(const std::string& file) {
  std::vector<double> all;
  std::istringstream lines(content_of(file));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    for (std::size_t k = cells.size() - 4; k + 1 < cells.size(); ++k) all.push_back(std::stod(cells[k]));
  }
  return all;
}

TEST_F(TuneCommand, SolveTunesOnFirstUseOnce) {
  const auto solve = [&](const std::string& out, const std::string& patches, const std::string& more) {
    return run({"solve", scene_file("cornell-box.obj"), "--patches", patches, "--device", "openmp", "--storage",
                "sym16", "-o", cache.file(out)},
               more);
  };
  const std::string large = "4500", on = "INTERFLECT_TUNING=on";
  const Outcome off = solve("off.csv", large, "INTERFLECT_TUNING=off");
  ASSERT_EQ(off.status, 0) << off.err;
  EXPECT_THAT(entries(), IsEmpty());
  EXPECT_EQ(solve("small.csv", "800", on).status, 0);
  EXPECT_THAT(entries(), IsEmpty()) << "it could not pay";
  const Outcome first = solve("first.csv", large, on);
  EXPECT_EQ(first.status, 0) << first.err;
  EXPECT_THAT(first.err, HasSubstr("interflect: tuned sym16 on openmp in "));
  EXPECT_THAT(entries(), SizeIs(1));
  const Outcome second = solve("second.csv", large, on);
  EXPECT_THAT(second.err, Not(HasSubstr("tuned")));
  const std::vector<double> plain = numbers_of(cache.file("off.csv"));
  ASSERT_GT(plain.size(), 4096U);
  for (const char* file : {"first.csv", "second.csv"}) {
    const std::vector<double> tuned = numbers_of(cache.file(file));
    ASSERT_EQ(tuned.size(), plain.size());
    for (std::size_t k = 0; k < plain.size(); ++k) ASSERT_NEAR(tuned[k], plain[k], 1e-5 * std::abs(plain[k]));
  }
  std::ofstream(entries().front(), std::ios::trunc) << "";  // damage: found anew, and no error
  const Outcome again = run({"solve", scene_file("cornell-box.obj"), "--patches", large, "--device", "openmp",
                             "--storage", "sym16", "--quiet", "-o", cache.file("again.csv")});
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_THAT(again.err, IsEmpty());
  EXPECT_THAT(nlohmann::json::parse(tune({"--list", "--json"}).out), SizeIs(1));
}

}  // namespace
}  // namespace interflect::test
