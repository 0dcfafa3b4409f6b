// View3D's files through `formfactors --between`: exact values, the order of the table, what is left out of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double opposite = 0.199824895698387;  // unit squares at distance 1
constexpr double bound = 1e-4;

const std::string corners = "V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n";

Outcome between(const Folder& folder, const std::string& text, std::vector<std::string> more = {"--json"}) {
  std::vector<std::string> arguments{"formfactors", folder.write("a.vs3", text), "--between", "--divide", "0.02"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  Outcome outcome = run_program(arguments);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  return outcome;
}

double factor(const json& table, std::size_t from, std::size_t to) {
  return table.at("factors").at(from).at(to).get<double>();
}

TEST(View3D, TwoPlates) {
  const Folder folder;
  const json table = json::parse(between(folder, corners + "S 1 1 2 3 4 0 0 .5 low\nS 2 8 7 6 5 0 0 .5 high\nE\n").out);
  EXPECT_THAT(table.at("groups"), ElementsAre("low", "high"));
  EXPECT_NEAR(factor(table, 0, 1), opposite, bound);
  EXPECT_NEAR(factor(table, 1, 0), opposite, bound);
  EXPECT_NEAR(table.at("sky").at(0).get<double>(), 1 - opposite, bound) << "the rest leaves the scene";
  EXPECT_FALSE(table.contains("left_out"));
}

/// Twin: with one plate's vertices the other way round the same comparison fails.
TEST(View3D, APlateThatLooksAwaySeesNothing) {
  const Folder folder;
  const json table = json::parse(between(folder, corners + "S 1 1 2 3 4 0 0 .5 low\nS 2 5 6 7 8 0 0 .5 high\nE\n").out);
  EXPECT_GT(std::abs(factor(table, 0, 1) - opposite), bound);
  EXPECT_EQ(factor(table, 0, 1), 0);
  EXPECT_EQ(table.at("sky").at(0).get<double>(), 1);
}

const std::string sides =
    "S 1 1 2 3 4 0 0 .5 zeq0\nS 2 1 4 8 5 0 0 .5 xeq0\nS 3 1 5 6 2 0 0 .5 yeq0\nS 4 7 6 5 8 0 0 .5 zeq1\n"
    "S 5 7 3 2 6 0 0 .5 xeq1\n";

TEST(View3D, TheCubeOfItsManual) {
  const Folder folder;
  const Outcome outcome =
      between(folder, "T cube\nC list=1\nF 3\n" + corners + sides + "S 6 7 8 4 3 0 0 .5 yeq1\nEnd of data\n");
  EXPECT_EQ(outcome.err, "");
  const json table = json::parse(outcome.out);
  EXPECT_THAT(table.at("groups"), ElementsAre("zeq0", "xeq0", "yeq0", "zeq1", "xeq1", "yeq1"));
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t j = 0; j < 6; ++j) {
      const double exact = i == j ? 0 : i % 3 == j % 3 ? opposite : (1 - opposite) / 4;
      EXPECT_NEAR(factor(table, i, j), exact, bound) << i << " " << j;
    }
    EXPECT_EQ(table.at("sky").at(i).get<double>(), 0) << "a closed scene has no sky";
  }
}

TEST(View3D, CombinedSurfacesAreOneRow) {
  const Folder folder;
  const json table = json::parse(between(folder, corners + sides + "S 6 7 8 4 3 0 3 .5 yeq1\n").out);
  EXPECT_THAT(table.at("groups"), ElementsAre("zeq0", "xeq0", "yeq0", "zeq1", "xeq1"));
  EXPECT_NEAR(table.at("areas").at(2).get<double>(), 2, 1e-12);
  EXPECT_NEAR(factor(table, 2, 2), opposite, bound);
  EXPECT_NEAR(factor(table, 0, 2), (1 - opposite) / 2, bound);
}

/// A window of half the cube's width and, at half its height, an obstruction of the same size: the same ratio again.
TEST(View3D, AnObstructionTakesLightAndHasNoRow) {
  const Folder folder;
  const std::string text = corners +
                           "V 9 .25 .25 0\nV 10 .75 .25 0\nV 11 .75 .75 0\nV 12 .25 .75 0\n"
                           "V 13 .25 .25 .5\nV 14 .75 .25 .5\nV 15 .75 .75 .5\nV 16 .25 .75 .5\n" +
                           sides + "S 6 7 8 4 3 0 0 .5 yeq1\nS 7 9 10 11 12 1 0 .5 window\nO 8 13 14 15 16\n";
  const json table = json::parse(between(folder, text).out);
  EXPECT_THAT(table.at("groups"), ElementsAre("zeq0", "xeq0", "yeq0", "zeq1", "xeq1", "yeq1", "window"));
  EXPECT_THAT(table.at("left_out"), ElementsAre("obstruction"));
  const json row = table.at("factors").at(6);
  ASSERT_EQ(row.size(), 7U);
  EXPECT_NEAR(std::accumulate(row.begin(), row.end(), 0.0, [](double s, const json& f) { return s + f.get<double>(); }),
              1 - opposite, 2e-3);
  EXPECT_NEAR(table.at("areas").at(0).get<double>(), 0.75, 1e-12) << "the wall without its window";
  EXPECT_THAT(between(folder, text, {}).out, HasSubstr("left out: obstruction"));
  // A file of form factors knows obstructions again.
  const std::string file = folder.file("a.iff");
  ASSERT_EQ(run_program({"formfactors", folder.file("a.vs3"), "--divide", "0.02", "-o", file}).status, 0);
  EXPECT_EQ(json::parse(run_program({"formfactors", file, "--between", "--json"}).out), table);
}

TEST(View3D, BadFilesEndWithTheirLine) {
  const Folder folder;
  for (const auto& [text, cause] :
       {std::pair<std::string, std::string>{"F 2\n", "a.vs3:1: F 2 is View3D's two-dim"},
        {corners + "S 1 1 2 9 0 0 0 .5 a\n", "a.vs3:9: third vertex: there is no vertex 9"}}) {
    const Outcome outcome = run_program({"formfactors", folder.write("a.vs3", text), "--between"});
    EXPECT_EQ(outcome.status, 3);
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr(cause)));
    EXPECT_EQ(outcome.out, "");
  }
}

}  // namespace
}  // namespace interflect::test
