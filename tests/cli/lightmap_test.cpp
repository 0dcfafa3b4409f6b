// Lightmaps through the program: the files and the exit statuses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Lightmap, IsInTheGlbAndBesideIt) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("cornell-box.obj"), "--patches", "600", "-o", folder.file("r.glb"), "--lightmap",
                   "--lightmap-size", "256", "--lightmap-padding", "3", "--lightmap-image", folder.file("r.exr"),
                   "--lightmap-image", folder.file("r.png"), "--device", "openmp"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("lightmap       256 x 256 texels, 16 charts, "));
  EXPECT_THAT(outcome.out, HasSubstr("texels per unit, padding 3\n"));
  EXPECT_THAT(outcome.out, HasSubstr("wrote          " + folder.file("r.exr")));
  EXPECT_THAT(folder.names(), ElementsAre("r.exr", "r.glb", "r.png"));
  const nlohmann::json json = nlohmann::json::parse(glb_text(folder.file("r.glb")));
  EXPECT_EQ(json["scenes"][0]["extras"]["interflect_lightmap"]["size"], 256);
  EXPECT_EQ(json["images"].size(), 1U);
  EXPECT_EQ(content_of(folder.file("r.png"))[24], 16);  // bits per channel
}

TEST(Lightmap, ADensityAskedForIsKept) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("furnace.obj"), "--divide", "0.1", "-o", folder.file("r.glb"), "--lightmap",
                   "--lightmap-size", "256", "--lightmap-density", "20"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("6 charts, 20 texels per unit, padding 2\n"));
  EXPECT_THAT(outcome.err, ::testing::Not(HasSubstr("coarser")));
}

TEST(Lightmap, OneThatIsCoarserThanThePatchesIsWarnedOf) {
  const Folder folder;
  const Outcome outcome = run_program({"solve", scene_file("furnace.obj"), "--patches", "3000", "-o",
                                       folder.file("r.glb"), "--lightmap", "--lightmap-size", "32"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("texels per patch (median)"));
}

struct Refused {
  int status;
  std::string words;
  std::vector<std::string> arguments;
};

TEST(Lightmap, WhatCannotBeIsRefusedBeforeTheWork) {
  const Folder folder;
  const std::string glb = folder.file("r.glb"), png = folder.file("r.png");
  const std::vector<Refused> cases{
      {2, "there is no -o FILE.glb", {"-o", folder.file("r.ply"), "--lightmap"}},
      {2,
       "r.jpg: a lightmap image is .exr or .png",
       {"-o", glb, "--lightmap", "--lightmap-image", folder.file("r.jpg")}},
      {2, "named twice", {"-o", glb, "-o", png, "--lightmap", "--lightmap-image", png}},
      {2, "--lightmap-size requires --lightmap", {"-o", glb, "--lightmap-size", "64"}},
      {2, "--lightmap-image requires --lightmap", {"-o", glb, "--lightmap-image", png}},
      {2, "'15' is not a number above 15", {"-o", glb, "--lightmap", "--lightmap-size", "15"}},
      {2, "'0' is not a number above 0", {"-o", glb, "--lightmap", "--lightmap-padding", "0"}},
      {2, "'nan' is not a number above 0", {"-o", glb, "--lightmap", "--lightmap-density", "nan"}},
      {3, "nowhere", {"-o", glb, "--lightmap", "--lightmap-image", folder.file("nowhere/r.png")}},
      {6, "does not hold 16 charts: --lightmap-size 32 does", {"-o", glb, "--lightmap", "--lightmap-size", "16"}},
      {6, "at 1000 texels per unit, nor does", {"-o", glb, "--lightmap", "--lightmap-density", "1000"}},
  };
  for (const Refused& refused : cases) {
    std::vector<std::string> arguments{"solve", scene_file("cornell-box.obj"), "--patches", "600"};
    arguments.insert(arguments.end(), refused.arguments.begin(), refused.arguments.end());
    const Outcome outcome = run_program(arguments);
    EXPECT_EQ(outcome.status, refused.status) << refused.words << "\n" << outcome.err;
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr(refused.words)));
  }
  const Outcome outcome =
      run_program({"solve", scene_file("cornell-box.obj"), "-o", glb, "--lightmap", "--lightmap-size", "8192"},
                  {"INTERFLECT_MEMORY=100M"});
  EXPECT_EQ(outcome.status, 6);
  EXPECT_THAT(outcome.err, HasSubstr("--lightmap-size 8192: the lightmap needs 2560 MiB"));
  EXPECT_THAT(folder.names(), ElementsAre());
}

}  // namespace
}  // namespace interflect::test
