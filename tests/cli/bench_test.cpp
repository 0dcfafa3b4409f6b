// What `bench` makes of rows that are there already: comparing, drawing, fitting. Nothing is timed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::ordered_json;

Json row(const std::string& what, double median, double iqr, const std::string& scene = "") {
  return {{"device", "openmp"},
          {"what", what},
          {"scene", scene},
          {"storage", scene.empty() ? "" : "dense32"},
          {"n", scene.empty() ? 0 : 1312},
          {"columns", scene.empty() ? 0 : 3},
          {"seconds", median},
          {"seconds_min", 0.9 * median},
          {"seconds_max", 1.1 * median},
          {"seconds_iqr", iqr},
          {"repetitions", 9},
          {"bytes", 1000000},
          {"status", "pass"},
          {"reason", ""}};
}

Json run_of(const std::vector<Json>& rows) {
  return {{"header", {{"interflect", "0.1.0"}, {"repetitions", 9}}}, {"rows", rows}};
}

/// Runs bench over prepared rows and gives its JSON.
Json bench(const Folder& folder, const Json& now, std::vector<std::string> more, int status = 0) {
  std::vector<std::string> arguments{"bench", "--from", folder.write("now.json", now.dump()), "--json",
                                     folder.file("out.json")};
  arguments.insert(arguments.end(), more.begin(), more.end());
  const Outcome outcome = run_program(arguments);
  EXPECT_EQ(outcome.status, status) << outcome.err;
  return Json::parse(content_of(folder.file("out.json")));
}

std::string change(const Json& before, const Json& after) {
  const Folder folder;
  const std::string old = folder.write("old.json", run_of({before}).dump());
  const Json compared = bench(folder, run_of({after}), {"--compare", old}).at("compared").at("rows");
  EXPECT_EQ(compared.size(), 1U);
  return compared.at(0).at("change");
}

TEST(BenchCompare, MarksWhatIsBeyondTheSpreadOfBothAndNothingElse) {
  EXPECT_EQ(change(row("read", 1.0, 0.02), row("read", 1.05, 0.02)), "SLOWER");
  EXPECT_EQ(change(row("read", 1.0, 0.03), row("read", 1.05, 0.03)), "same");   // within both together
  EXPECT_EQ(change(row("read", 1.0, 0.04), row("read", 1.05, 0.0)), "SLOWER");  // beyond the one that there is
  EXPECT_EQ(change(row("read", 1.0, 0.02), row("read", 0.95, 0.02)), "faster");
  EXPECT_EQ(change(row("read", 1.0, 0.03), row("read", 0.95, 0.03)), "same");
  EXPECT_EQ(change(row("read", 1.0, 0.0), row("read", 1.02, 0.0)), "same");  // two runs differ by as much
  EXPECT_EQ(change(row("read", 1.0, 0.0), row("read", 1.031, 0.0)), "SLOWER");
}

TEST(BenchCompare, OnePassOrAFailedRowIsNotJudged) {
  Json once = row("read", 1.0, 0.0);
  once["repetitions"] = 1;
  EXPECT_EQ(change(once, row("read", 9.0, 0.0)), "not judged");
  EXPECT_EQ(change(row("read", 9.0, 0.0), once), "not judged");
  Json unsupported = row("read", 0.0, 0.0);
  unsupported["status"] = "unsupported";
  EXPECT_EQ(change(unsupported, row("read", 1.0, 0.0)), "not judged");
}

TEST(BenchCompare, AFileWithoutQuartilesIsJudgedByItsRange) {
  Json before = row("read", 1.0, 0.0);  // 0.9 to 1.1
  before.erase("seconds_iqr");
  EXPECT_EQ(change(before, row("read", 1.15, 0.0)), "same");
  EXPECT_EQ(change(before, row("read", 1.25, 0.0)), "SLOWER");
}

TEST(BenchCompare, ListsRowsOfOneFileOnlyAndKeepsTheOthersApart) {
  const Folder folder;
  const std::string old = folder.write(
      "old.json", run_of({row("read", 1.0, 0), row("matvec", 2.0, 0, "a"), row("matvec", 4.0, 0, "b")}).dump());
  const Json now = run_of({row("matvec", 3.0, 0, "b"), row("copy", 1.0, 0), row("matvec", 2.0, 0, "a")});
  const Json compared = bench(folder, now, {"--compare", old}).at("compared").at("rows");
  std::vector<std::string> found;
  for (const Json& one : compared) {
    found.push_back(one.at("what").get<std::string>() + one.at("scene").get<std::string>() + ": " +
                    one.at("change").get<std::string>());
  }
  EXPECT_THAT(found, ElementsAre("matvecb: faster", "copy: new", "matveca: same", "read: only in the old file"));
  EXPECT_EQ(compared.at(0).at("ratio"), 0.75);
  EXPECT_EQ(compared.at(0).at("old_seconds"), 4.0);
  EXPECT_TRUE(compared.at(1).at("old_seconds").is_null());
  EXPECT_TRUE(compared.at(3).at("new_seconds").is_null());
}

TEST(BenchCompare, SlowerIsNoFailureButARowThatIsWrongIs) {
  const Folder folder;
  const std::string old = folder.write("old.json", run_of({row("read", 1.0, 0)}).dump());
  static_cast<void>(bench(folder, run_of({row("read", 5.0, 0)}), {"--compare", old}, 0));
  Json wrong = row("read", 1.0, 0);
  wrong["status"] = "fail";
  wrong["error"] = nullptr;  // a NaN
  const Json out = bench(folder, run_of({wrong}), {"--compare", old}, 4);
  EXPECT_TRUE(out.at("rows").at(0).at("error").is_null());
}

class BrokenFile : public ::testing::TestWithParam<std::pair<std::string, std::string>> {};

TEST_P(BrokenFile, IsAnInputErrorOfOneLineWhereverItIsGiven) {
  const auto& [content, named] = GetParam();
  const Folder folder;
  const std::string file = folder.write("old.json", content);
  for (const char* option : {"--compare", "--from"}) {
    const Outcome outcome = run_program({"bench", option, file, "--json", folder.file("out.json")});
    EXPECT_EQ(outcome.status, 3) << option << outcome.err;
    ASSERT_EQ(outcome.error_lines().size(), 1U) << outcome.err;
    EXPECT_THAT(outcome.error_lines().front(), HasSubstr("old.json: "));
    EXPECT_THAT(outcome.error_lines().front(), HasSubstr(named));
    EXPECT_EQ(outcome.out, "");
    EXPECT_THAT(folder.names(), ElementsAre("old.json"));
  }
}

std::string with(const char* field, Json value) {
  Json one = row("read", 1.0, 0);
  one[field] = std::move(value);
  return run_of({row("copy", 1.0, 0), one}).dump();
}

std::string without(const char* field) {
  Json one = row("read", 1.0, 0);
  one.erase(field);
  return run_of({row("copy", 1.0, 0), one}).dump();
}

const std::string whole = run_of({row("read", 1.0, 0)}).dump();

INSTANTIATE_TEST_SUITE_P(
    Files, BrokenFile,
    ::testing::Values(
        std::pair{std::string(), std::string("no JSON")},
        std::pair{whole.substr(0, whole.size() / 2), std::string("no JSON")},
        std::pair{std::string("device,what\n"), std::string("no JSON")},
        std::pair{std::string(100000, '['), std::string("old.json: ")},
        std::pair{std::string("[]"), std::string("no header and rows")},
        std::pair{std::string("{\"header\": {}, \"rows\": {}}"), std::string("no header and rows")},
        std::pair{std::string("{\"header\": [], \"rows\": []}"), std::string("no header and rows")},
        std::pair{std::string("{\"header\": {}, \"rows\": [3]}"), std::string("row 1 is no object")},
        std::pair{with("seconds", "1"), std::string("row 2 has 'seconds'")},
        std::pair{with("seconds", nullptr), std::string("row 2 has 'seconds'")},
        std::pair{with("seconds", -1.0), std::string("row 2 has 'seconds'")},
        std::pair{with("seconds_iqr", Json::array()), std::string("row 2 has 'seconds_iqr'")},
        std::pair{with("seconds_min", 2.0), std::string("row 2 has a median outside")},
        std::pair{with("n", -5), std::string("row 2 has 'n'")},
        std::pair{with("n", 4294967296), std::string("row 2 has 'n'")},
        std::pair{with("n", 1.5), std::string("row 2 has 'n'")},
        std::pair{with("device", 7), std::string("row 2 has 'device'")},
        std::pair{with("status", "good"), std::string("row 2 has a status")},
        std::pair{without("device"), std::string("row 2 has no 'device'")},
        std::pair{without("seconds"), std::string("row 2 has no 'seconds'")},
        std::pair{without("status"), std::string("row 2 has no 'status'")},
        std::pair{std::string("{\"header\": {}, \"rows\": [{\"seconds\": NaN}]}"), std::string("no JSON")},
        std::pair{std::string("{\"header\": {}, \"rows\": [{\"seconds\": 1e999}]}"), std::string("no JSON")}));

/// Sizes with t = factor n^time and b = 12 n^bytes.
std::vector<Json> growing(double time, double bytes) {
  std::vector<Json> rows;
  for (const unsigned n : {1000U, 2100U, 3900U, 8000U}) {
    Json one = row("growth", 1e-9 * std::pow(n, time), 0, "room");
    one["n"] = n;
    one["bytes"] = static_cast<std::uint64_t>(std::llround(12 * std::pow(n, bytes)));
    rows.push_back(one);
  }
  return rows;
}

TEST(BenchGrowth, FindsTheExponentsOfPowerLaws) {
  const Folder folder;
  const Json growth = bench(folder, run_of(growing(1.75, 2)), {}).at("growth");
  ASSERT_EQ(growth.size(), 1U);
  const Json& one = growth.at(0);
  EXPECT_EQ(one.at("n"), Json({1000, 2100, 3900, 8000}));
  EXPECT_NEAR(one.at("time").at("exponent").get<double>(), 1.75, 1e-9);
  EXPECT_NEAR(one.at("time").at("factor").get<double>(), 1e-9, 1e-17);
  EXPECT_NEAR(one.at("bytes").at("exponent").get<double>(), 2, 1e-9);
  EXPECT_LT(one.at("time").at("deviation").get<double>(), 1e-9);
  EXPECT_EQ(one.at("time").at("power_law"), true);
}

TEST(BenchGrowth, SaysSoWhenThereIsNone) {
  const Folder folder;
  std::vector<Json> rows = growing(2, 2);
  for (Json& one : rows) {  // grows by the logarithm of n
    const double seconds = std::log(one.at("n").get<double>() / 900);
    for (const char* field : {"seconds", "seconds_min", "seconds_max"}) one[field] = seconds;
  }
  const Json one = bench(folder, run_of(rows), {}).at("growth").at(0);
  EXPECT_EQ(one.at("time").at("power_law"), false);
  EXPECT_GT(one.at("time").at("deviation").get<double>(), 0.25);
  EXPECT_EQ(one.at("bytes").at("power_law"), true);
}

TEST(BenchGrowth, FitsNothingToTwoSizesOrToRowsThatFailed) {
  const Folder folder;
  std::vector<Json> rows = growing(2, 2);
  rows.at(3)["status"] = "unsupported";
  rows.at(2)["storage"] = "sym16";
  const Json growth = bench(folder, run_of(rows), {}).at("growth");
  ASSERT_EQ(growth.size(), 2U);
  EXPECT_EQ(growth.at(0).at("n"), Json({1000, 2100}));
  EXPECT_TRUE(growth.at(0).at("time").is_null());
  EXPECT_EQ(growth.at(1).at("n"), Json({3900}));
}

/// The cells of a CSV, quotes undone.
std::vector<std::vector<std::string>> table(const std::string& csv) {
  std::vector<std::vector<std::string>> lines(1, std::vector<std::string>(1));
  bool quoted = false;
  for (std::size_t k = 0; k < csv.size(); ++k) {
    std::string& cell = lines.back().back();
    if (csv[k] == '"' && quoted && k + 1 < csv.size() && csv[k + 1] == '"')
      cell += csv[++k];
    else if (csv[k] == '"')
      quoted = !quoted;
    else if (csv[k] == ',' && !quoted)
      lines.back().emplace_back();
    else if (csv[k] == '\n' && !quoted)
      lines.emplace_back(1, "");
    else
      cell += csv[k];
  }
  lines.pop_back();
  return lines;
}

TEST(BenchFiles, CsvAndJsonSayTheSame) {
  const Folder folder;
  Json odd = row("matvec", 0.125, 0.5, "a, \"b\"\nc");
  odd["machine_ratio"] = 0.75;
  odd["reason"] = "said: \"no\", twice";
  odd["launch_share"] = nullptr;
  const Json out = bench(folder, run_of({row("read", 1.0, 0), odd}), {"--csv", folder.file("out.csv")});
  const auto lines = table(content_of(folder.file("out.csv")));
  ASSERT_EQ(lines.size(), 3U);
  for (std::size_t k = 0; k < 2; ++k) {
    const Json& fields = out.at("rows").at(k);
    ASSERT_EQ(lines.at(k + 1).size(), fields.size());
    std::size_t column = 0;
    for (const auto& [name, value] : fields.items()) {
      const std::string& cell = lines.at(k + 1).at(column);
      EXPECT_EQ(lines.front().at(column++), name);
      if (value.is_null()) {
        EXPECT_EQ(cell, "") << name;
      } else if (value.is_string()) {
        EXPECT_EQ(cell, value.get<std::string>()) << name;
      } else {
        EXPECT_EQ(Json::parse(cell), value) << name;
      }
    }
  }
  // What programs know by its place: gpu-check.sh takes GB/s from the eleventh column.
  EXPECT_EQ(lines.front().at(10), "gb_per_s");
}

TEST(BenchFiles, WhatWasReadIsWrittenAgainAsItWas) {
  const Folder folder;
  const Json once = bench(folder, run_of({row("read", 1.0, 0.01), row("matvec", 0.3, 0.1, "a")}), {});
  const Json twice = bench(folder, once, {});
  EXPECT_EQ(once, twice);
}

}  // namespace
}  // namespace interflect::test
