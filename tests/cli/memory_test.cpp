// --memory: form factors that exceed it stay in the file and stream through every product.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string small_panels = "INTERFLECT_MAX_PANEL_BYTES=200000";  // 32 rows of 1,312: 41 panels of 164 KiB
const std::string quarter = "1640K";

std::vector<std::string> solving(const std::vector<std::string>& more) {
  std::vector<std::string> arguments{"solve", scene_file("room-1312.obj"), "--divide", "1", "--device", "openmp"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

/// The largest difference of two .csv files' radiosities, as a share of the largest.
double difference(const std::string& a, const std::string& b) {
  const auto values = [](const std::string& file) {
    std::vector<double> out;
    std::istringstream lines(content_of(file));
    std::string line;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      std::vector<std::string> cells;
      std::istringstream row(line);
      for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
      for (std::size_t k = cells.size() - 4; k + 1 < cells.size(); ++k) out.push_back(std::stod(cells[k]));
    }
    return out;
  };
  const std::vector<double> x = values(a), y = values(b);
  EXPECT_EQ(x.size(), 3U * 1312);
  EXPECT_EQ(x.size(), y.size());
  double largest = 0, off = 0;
  for (std::size_t k = 0; k < std::min(x.size(), y.size()); ++k) {
    largest = std::max(largest, std::abs(y[k]));
    off = std::max(off, std::abs(x[k] - y[k]));
  }
  return off / largest;
}

TEST(Memory, AQuarterOfItGivesTheSameFileAndTheSameLight) {
  const Folder folder;
  const std::string whole = folder.file("whole.iff"), part = folder.file("part.iff");
  const Outcome in_memory = run_program(
      solving({"--form-factors", whole, "-o", folder.file("whole.csv"), "--report", folder.file("whole.json")}),
      {small_panels});
  ASSERT_EQ(in_memory.status, 0) << in_memory.err;
  const Outcome computed = run_program(solving({"--form-factors", part, "--memory", quarter, "-o",
                                                folder.file("part.csv"), "--report", folder.file("part.json")}),
                                       {small_panels});
  ASSERT_EQ(computed.status, 0) << computed.err;
  EXPECT_EQ(content_of(part), content_of(whole));
  EXPECT_LE(difference(folder.file("part.csv"), folder.file("whole.csv")), 2e-5);
  EXPECT_THAT(computed.out, HasSubstr("7 of 41 panels in memory"));

  const json report = json::parse(content_of(folder.file("part.json")));
  const json expected = json::parse(content_of(folder.file("whole.json")));
  EXPECT_FALSE(expected.at("storage").contains("streamed"));
  const json& streamed = report.at("storage").at("streamed");
  EXPECT_EQ(streamed.at("panels"), 41);
  EXPECT_EQ(streamed.at("resident"), 7);
  EXPECT_GT(streamed.at("bytes_read_per_product").get<double>(),
            0.7 * expected.at("storage").at("bytes").get<double>());
  EXPECT_GT(streamed.at("seconds_waiting").get<double>(), 0) << "a product cannot begin before its panel is read";
  EXPECT_EQ(report.at("storage").at("format"), "dense32");
  EXPECT_EQ(report.at("storage").at("nonzero_fraction"), expected.at("storage").at("nonzero_fraction"));
  EXPECT_EQ(report.at("closure"), expected.at("closure"));
  EXPECT_LT(report.at("energy").at("balance_error").get<double>(), 1e-5);

  // The file serves again, whole or in part; a forced closure is found anew.
  const Outcome reused =
      run_program(solving({"--form-factors", whole, "--memory", quarter, "-o", folder.file("again.csv")}));
  ASSERT_EQ(reused.status, 0) << reused.err;
  EXPECT_EQ(content_of(folder.file("again.csv")), content_of(folder.file("part.csv")));
  const Outcome open = run_program(solving({"--form-factors", whole, "--memory", quarter, "--closure", "off"}));
  EXPECT_EQ(open.status, 0) << open.err;
  EXPECT_THAT(open.err, HasSubstr("closure is found anew"));
}

TEST(Memory, FormFactorsOfAnyMemory) {
  const Folder folder;
  const std::string file = folder.file("part.iff"), whole = folder.file("whole.iff");
  const std::vector<std::string> command{"formfactors", scene_file("room-1312.obj"), "--divide", "1"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), command.begin(), command.end());
    return run_program(more, {small_panels});
  };
  const Outcome between = with({"--memory", quarter, "-o", file, "--between", "--json"});
  ASSERT_EQ(between.status, 0) << between.err;
  EXPECT_EQ(with({"-o", whole, "--between", "--json"}).out, between.out);
  EXPECT_EQ(content_of(file), content_of(whole));
}

TEST(Memory, SaysWhatDoesNotFitAndHow) {
  const Folder folder;
  const Outcome without = run_program(solving({"--memory", quarter}));
  EXPECT_EQ(without.status, 6);
  EXPECT_THAT(without.error_lines(), ElementsAre(HasSubstr("--form-factors FILE.iff")));
  const Outcome factors =
      run_program({"formfactors", scene_file("room-1312.obj"), "--divide", "1", "--memory", quarter, "--between"});
  EXPECT_EQ(factors.status, 6);
  EXPECT_THAT(factors.error_lines(), ElementsAre(HasSubstr("-o FILE.iff")));
  const Outcome tiny =
      run_program(solving({"--memory", "300K", "--form-factors", folder.file("a.iff")}), {small_panels});
  EXPECT_EQ(tiny.status, 6);
  EXPECT_THAT(tiny.err, HasSubstr("two panels"));
  for (const char* size : {"much", "-4G", ""}) {
    const Outcome wrong = run_program(solving({"--memory", size}));
    EXPECT_EQ(wrong.status, 2) << size;
    // Before any file is looked at.
    EXPECT_EQ(run_program({"formfactors", folder.file("none.iff"), "--memory", size}).status, 2) << size;
  }
  const Outcome packed = run_program(
      solving({"--memory", quarter, "--storage", "sym16", "--form-factors", folder.file("b.iff")}), {small_panels});
  EXPECT_EQ(packed.status, 6);
  EXPECT_THAT(packed.err, HasSubstr("--storage dense32"));
}

TEST(Memory, ADamagedPanelEndsTheSolveWithItsName) {
  const Folder folder;
  const std::string file = folder.file("room.iff");
  ASSERT_EQ(run_program(solving({"--memory", quarter, "--form-factors", file}), {small_panels}).status, 0);
  std::string content = content_of(file);
  content[content.size() / 2] = static_cast<char>(content[content.size() / 2] ^ 1);
  static_cast<void>(folder.write("room.iff", content));
  const Outcome outcome =
      run_program(solving({"--memory", quarter, "--form-factors", file, "-o", folder.file("a.csv"), "--quiet"}));
  EXPECT_EQ(outcome.status, 3);
  EXPECT_THAT(outcome.error_lines(), ElementsAre(testing::AllOf(HasSubstr("room.iff"), HasSubstr("panel 2"))));
  EXPECT_FALSE(std::filesystem::exists(folder.file("a.csv")));
}

}  // namespace
}  // namespace interflect::test
