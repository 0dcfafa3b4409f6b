// The certificate of the form factors as `formfactors` and `solve` print it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// The unit cube seen from inside; its last wall's corners in this order.
std::string cube(const std::string& last_wall) {
  return "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\ng floor\nf 1 2 3 4\ng west\nf 1 4 8 "
         "5\n"
         "g south\nf 1 5 6 2\ng ceiling\nf 7 6 5 8\ng east\nf 7 3 2 6\ng north\nf " +
         last_wall + "\n";
}

TEST(Certificate, NamesAFlippedWallAndWhatTheClosureMoved) {
  const Folder folder;
  const std::string scene = folder.write("a.obj", cube("3 4 8 7"));
  const Outcome outcome = run_program({"formfactors", scene, "--divide", "0.02", "--json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const json closure = json::parse(outcome.out).at("closure");
  const json& moved = closure.at("moved");
  EXPECT_GT(moved.at("worst").get<double>(), 0.05);
  EXPECT_GT(moved.at("count").get<std::size_t>(), 0U);
  EXPECT_EQ(moved.at("count").get<std::size_t>(), moved.at("patches").size());
  const json& certificate = closure.at("certificate");
  EXPECT_GT(certificate.at("off").get<std::size_t>(), certificate.at("rows").get<std::size_t>() / 2);
  ASSERT_EQ(certificate.at("worst").size(), 20U);
  for (const json& row : certificate.at("worst")) {
    EXPECT_EQ(row.at("cause"), "flipped normal");
    EXPECT_EQ(row.at("other"), "north");
    EXPECT_LT(row.at("deviation").get<double>(), 0);
    EXPECT_EQ(row.at("centroid").size(), 3U);
  }
  EXPECT_THAT(outcome.err, HasSubstr("closure moved a factor by"));
  const Outcome text = run_program({"formfactors", scene, "--divide", "0.02"});
  EXPECT_THAT(text.out, AllOf(HasSubstr("worst rows"), HasSubstr("flipped normal, see north")));
}

/// Twin: the same cube with the wall as it should be.
TEST(Certificate, ASoundCubeHasNothingToName) {
  const Folder folder;
  const std::string scene = folder.write("a.obj", cube("7 8 4 3"));
  const Outcome outcome = run_program({"formfactors", scene, "--divide", "0.02", "--json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const json closure = json::parse(outcome.out).at("closure");
  EXPECT_EQ(closure.at("moved").at("count"), 0);
  EXPECT_LT(closure.at("moved").at("worst").get<double>(), 0.01);
  EXPECT_EQ(closure.at("certificate").at("off"), 0);
  for (const json& row : closure.at("certificate").at("worst")) EXPECT_EQ(row.at("cause"), "sampling error");
  const Outcome solve = run_program({"solve", scene, "--divide", "0.02", "--device", "openmp"});
  EXPECT_THAT(solve.out + solve.err,
              AllOf(HasSubstr("none is off by more than sampling explains"), Not(HasSubstr("flipped"))));
}

}  // namespace
}  // namespace interflect::test
