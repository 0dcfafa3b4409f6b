// Pictures of solved scenes: films, cameras on a path, what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>

#include "camera_path.h"
#include "frame_names.h"
#include "interflect/base/error.h"
#include "program.h"

namespace interflect::test {
namespace {

using cli::CameraPath;
using cli::KeyCamera;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

class Render : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = std::make_unique<Folder>();
    const Outcome solved =
        run_program({"solve", scene_file("cornell-box.obj"), "--divide", "12000", "-o", solved_file()});
    ASSERT_EQ(solved.status, 0) << solved.err;
  }
  static void TearDownTestSuite() { shared_.reset(); }
  static std::string solved_file() { return shared_->file("box.glb"); }

  Outcome render(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"render", solved_file(), "--size", "48x32", "--samples", "4"});
    return run_program(arguments);
  }
  /// One line that says so, and the status.
  void expect_error(const std::vector<std::string>& arguments, int status, const std::string& part) const {
    const Outcome outcome = render(arguments);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_THAT(outcome.error_lines(), SizeIs(1));
    EXPECT_THAT(outcome.err, HasSubstr(part));
  }

  Folder folder;
  static std::unique_ptr<Folder> shared_;
};
std::unique_ptr<Folder> Render::shared_;

constexpr const char* eyes = "--camera";
constexpr const char* view = "278,273,-800,278,273,0,39.3";

TEST_F(Render, AnInterruptedFilmGoesOnWithTheSameFrames) {
  const std::string names = folder.file("whole-%03d.png"), rest = folder.file("rest-%03d.png");
  ASSERT_EQ(render({"--orbit", "--frames", "5", eyes, view, "-o", names}).status, 0);
  ASSERT_EQ(render({"--orbit", "--frames", "5", eyes, view, "--first", "3", "-o", rest}).status, 0);
  EXPECT_THAT(folder.names(), ElementsAre("rest-003.png", "rest-004.png", "whole-000.png", "whole-001.png",
                                          "whole-002.png", "whole-003.png", "whole-004.png"));
  for (const char* k : {"003", "004"}) {
    EXPECT_TRUE(content_of(folder.file(std::string("rest-") + k + ".png")) ==
                content_of(folder.file(std::string("whole-") + k + ".png")));
  }
  EXPECT_FALSE(content_of(folder.file("whole-000.png")) == content_of(folder.file("whole-001.png")));
}

TEST_F(Render, APathIsTheSameFromJsonAndCsv) {
  const std::string as_json = folder.write("path.json", R"({"keys": [
    {"time": 0, "eye": [278, 273, -800], "target": [278, 273, 0]},
    {"time": 1, "eye": [100, 273, -700], "target": [278, 200, 0]},
    {"time": 2, "eye": [278, 400, -400], "target": [278, 100, 300], "fov": 60}]})");
  const std::string as_csv = folder.write("path.csv",
                                          "time,ex,ey,ez,tx,ty,tz,fov\n"
                                          "0, 278,273,-800, 278,273,0\n"
                                          "1, 100,273,-700, 278,200,0   # to the left\n\n"
                                          "2, 278,400,-400, 278,100,300, 60\r\n");
  const Outcome json = render({"--path", as_json, "--fps", "2", "-o", folder.file("j%d.png")});
  ASSERT_EQ(json.status, 0) << json.err;
  EXPECT_THAT(json.out, HasSubstr("one for all frames"));
  ASSERT_EQ(render({"--path", as_csv, "--fps", "2", "-o", folder.file("c%d.png")}).status, 0);
  EXPECT_THAT(folder.names(), SizeIs(2 + 2 * 5));  // 2 s, 2 frames a second, and the last
  for (const char* k : {"0.png", "1.png", "2.png", "3.png", "4.png"}) {
    EXPECT_TRUE(content_of(folder.file(std::string("j") + k)) == content_of(folder.file(std::string("c") + k)));
  }
}

TEST_F(Render, WhatIsWrongIsSaidInOneLine) {
  const auto path = [&](const std::string& name, const std::string& text) { return folder.write(name, text); };
  const std::string out = folder.file("f%d.png");
  const auto with = [&](const std::string& file) { return std::vector<std::string>{"--path", file, "-o", out}; };
  expect_error(with(folder.file("none.csv")), 3, "none.csv");
  expect_error(with(path("a.csv", "0,1,2,3,4,5\n")), 3, "a.csv: line 1: 6 values");
  expect_error(with(path("b.csv", "time,x\n0,1,2,3,4,5,6\n1,1,2,x,4,5,6\n")), 3, "line 3: 'x' is not a number");
  expect_error(with(path("c.csv", "1,1,2,3,4,5,6\n1,2,2,3,4,5,6\n")), 3, "line 2: the time 1 does not come after 1");
  expect_error(with(path("d.csv", "1,1,2,3,4,5,6\n,2,2,3,4,5,6\n")), 3, "line 2: some keys have a time");
  expect_error(with(path("e.csv", "0,1,2,3,1,2,3\n")), 3, "line 1: eye, target and up give no view");
  expect_error(with(path("f.csv", "\n")), 3, "holds no key cameras");
  expect_error(with(path("a.json", "[{\"eye\": [0, 0, 1]}]")), 3, "a.json: key 1: 'target' is missing");
  expect_error(with(path("b.json", "{\"keys\": 3}")), 3, "neither a list");
  expect_error(with(path("c.json", "[")), 3, "not JSON");
  expect_error(with(path("d.json", R"([{"eye": [0, 0, 1], "target": [0, 0, 0], "zoom": 2}])")), 3,
               "'zoom' is not known");
  expect_error(with(path("a.txt", "")), 2, "neither .json nor .csv");
  expect_error({"--orbit", "-o", folder.file("f.png")}, 2, "need a number");
  expect_error({"--orbit", "-o", folder.file("f%s.png")}, 2, "after a % comes d");
  expect_error({"--orbit", "-o", folder.file("%d-%d.png")}, 2, "one number is enough");
  expect_error({"--orbit", "--frames", "3", "--first", "3", "-o", out}, 2, "the film has 3 frames");
  expect_error({"--frames", "3", "-o", folder.file("f.png")}, 2, "--path FILE or --orbit");
  expect_error({"-o", folder.file("f.glb")}, 2, "is not a picture");
  expect_error({"-o", folder.file("missing/f.png")}, 3, "missing/f.png");
  for (const std::string& name : folder.names()) EXPECT_NE(std::filesystem::path(name).extension(), ".png") << name;
}

TEST_F(Render, ADamagedSolvedFileIsNamedAndAnyOtherGlbIsSolved) {
  std::string bytes = content_of(solved_file());
  const auto rename = [&](const std::string& from, const std::string& to) {
    for (auto at = bytes.find(from); at != std::string::npos; at = bytes.find(from)) bytes.replace(at, from.size(), to);
  };
  rename("\"_RADIOSITY\"", "\"_RADIOSITX\"");
  const std::string bad = folder.write("bad.glb", bytes);
  const Outcome outcome = run_program({"render", bad, "-o", folder.file("bad.png")});
  EXPECT_EQ(outcome.status, 3);
  EXPECT_THAT(outcome.error_lines(), SizeIs(1));
  EXPECT_THAT(outcome.err, HasSubstr("bad.glb: solved GLB: mesh"));
  EXPECT_THAT(outcome.err, HasSubstr("_RADIOSITY is missing"));
  rename("\"Interflect\"", "\"Interflecx\"");
  const std::string other = folder.write("other.glb", bytes);
  const Outcome plain = run_program({"render", other, "-o", folder.file("other.png"), "--size", "48x32"});
  EXPECT_EQ(plain.status, 0) << plain.err;
  EXPECT_THAT(folder.names(), ElementsAre("bad.glb", "other.glb", "other.png"));
}

TEST_F(Render, ASceneIsSolvedFirst) {
  const Outcome outcome = run_program({"render", scene_file("furnace.obj"), "--divide", "0.1", "-o",
                                       folder.file("a.exr"), "-o", folder.file("a.png"), "--size", "32x32"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(folder.names(), ElementsAre("a.exr", "a.png"));
}

TEST_F(Render, ATextureOfTheSceneIsNotReplaced) {
  ASSERT_EQ(render({"-o", folder.file("wood.png")}).status, 0);
  const std::string wood = content_of(folder.file("wood.png"));
  (void)folder.write("t.mtl", "newmtl floor\nKd 1 1 1\nmap_Kd wood.png\nnewmtl lamp\nKd 0 0 0\nKe 9 9 9\n");
  const std::string scene = folder.write("t.obj",
                                         "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 0 1 0\nv 1 1 0\n"
                                         "v 1 1 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
                                         "usemtl floor\nf 4/4 3/3 2/2 1/1\nusemtl lamp\nf 5 6 7 8\n");
  for (const char* command : {"render", "solve"}) {
    const Outcome outcome = run_program({command, scene, "--size", "16x16", "-o", folder.file("wood.png")});
    EXPECT_EQ(outcome.status, 2) << command;
    EXPECT_THAT(outcome.err, HasSubstr("wood.png belongs to the scene")) << command;
    EXPECT_TRUE(content_of(folder.file("wood.png")) == wood) << command;
    // The twin: beside it.
    EXPECT_EQ(run_program({command, scene, "--size", "16x16", "-o", folder.file("b.png")}).status, 0) << command;
  }
  const std::string kept = folder.file("kept.png");
  const Outcome factors = run_program({"render", scene, "--form-factors", kept, "-o", kept});
  EXPECT_EQ(factors.status, 2);
  EXPECT_THAT(factors.err, HasSubstr("is the file of form factors"));
}

Camera camera_at(Vec3 eye) {
  return {eye, {0, 0, 0}, {0, 1, 0}, 1};
}

TEST(CameraPathTest, PassesThroughItsKeysWithoutAKink) {
  const CameraPath path(
      {{0, camera_at({0, 0, 5})}, {1, camera_at({4, 0, 5})}, {3, camera_at({4, 3, 5})}, {4, camera_at({0, 3, 9})}});
  EXPECT_EQ(path.at(0).eye, (Vec3{0, 0, 5}));
  EXPECT_EQ(path.at(1).eye, (Vec3{4, 0, 5}));
  EXPECT_EQ(path.at(9).eye, (Vec3{0, 3, 9}));
  constexpr double h = 1e-6;
  for (const double key : {1.0, 3.0}) {
    const Vec3 before = (path.at(key).eye - path.at(key - h).eye) / h,
               after = (path.at(key + h).eye - path.at(key).eye) / h;
    EXPECT_LT(length(after - before), 1e-4) << key;
    EXPECT_GT(length(after), 0.5);
  }
  // Straight lines between keys, the twin, have a kink.
  EXPECT_GT(length((Vec3{4, 3, 5} - Vec3{4, 0, 5}) / 2 - Vec3{4, 0, 0}), 1);
}

TEST(CameraPathTest, EvenKeysGiveEvenSpeedOnAStraightLine) {
  const CameraPath path({{0, camera_at({0, 1, 5})}, {1, camera_at({1, 1, 5})}, {2, camera_at({2, 1, 5})}});
  for (double t = 0; t <= 2; t += 0.1) EXPECT_NEAR(path.at(t).eye.x, t, 1e-12);
}

TEST(CameraPathTest, WithoutTimesTheyAreCentripetal) {
  const Folder folder;
  const std::string file = folder.write("p.csv", ",0,0,5,0,0,0\n,1,0,5,0,0,0\n,1,4,5,0,0,0\n");
  const CameraPath path = cli::read_camera_path(file, {});
  EXPECT_EQ(path.begin(), 0);
  EXPECT_EQ(path.end(), 1);
  EXPECT_NEAR(length(path.at(1.0 / 3).eye - Vec3{1, 0, 5}), 0, 1e-12);  // √1 and √4
}

TEST(CameraPathTest, WithoutTimesKeysThatDistancesDoNotTellApartAreNamed) {
  const Folder folder;
  const auto error_of = [&](const std::string& keys) -> std::string {
    try {
      (void)cli::read_camera_path(folder.write("p.csv", keys), {});
      return "read";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      return error.what();
    }
  };
  EXPECT_THAT(error_of(",0,0,0,0,0,1\n,1e200,0,0,1e200,0,1\n"), HasSubstr("line 2: too far"));
  EXPECT_THAT(error_of(",0,0,0,0,0,1\n,1e30,0,0,1e30,0,1\n,1e30,0,0,1e30,0,1.0001\n"), HasSubstr("line 3: too close"));
  EXPECT_EQ(error_of(",0,0,0,0,0,1\n,1e3,0,0,1e3,0,1\n,1e3,0,0,1e3,0,1.0001\n"), "read");
}

TEST(CameraPathTest, AnOrbitComesBack) {
  const Camera camera{{3, 2, 0}, {1, 1, 1}, {0, 1, 0}, 1};
  EXPECT_EQ(cli::orbit(camera, 0, 8).eye, camera.eye);
  EXPECT_LT(length(cli::orbit(camera, 8, 8).eye - camera.eye), 1e-12);
  const Camera half = cli::orbit(camera, 4, 8);
  EXPECT_LT(length(half.eye - Vec3{-1, 2, 2}), 1e-12);
}

TEST(FrameNames, PutTheNumberIn) {
  EXPECT_EQ(cli::frame_name("a-%04d.png", 7), "a-0007.png");
  EXPECT_EQ(cli::frame_name("a-%d.png", 12345), "a-12345.png");
  EXPECT_EQ(cli::frame_name("100%%-%3d", 7), "100%-  7");
  EXPECT_EQ(cli::frame_name(cli::as_pattern("50%d") + "-%d", 7), "50%d-7");
  EXPECT_THROW(cli::check_frame_names({"a-%x.png"}, true), Error);
  EXPECT_THROW(cli::check_frame_names({"a-%"}, true), Error);
  EXPECT_THROW(cli::check_frames_spare({"/tmp/%d.png"}, 0, 3, {"/tmp/2.png"}), Error);
  EXPECT_NO_THROW(cli::check_frames_spare({"/tmp/%d.png"}, 0, 2, {"/tmp/2.png"}));
}

}  // namespace
}  // namespace interflect::test
