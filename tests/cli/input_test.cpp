// Bad scenes end with status 3 and one line naming file, line or element, and cause; what will not fit with status 6.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

void expect_input_error(const Outcome& outcome, const std::string& file, const std::string& cause) {
  EXPECT_EQ(outcome.status, 3) << outcome.err;
  ASSERT_EQ(outcome.error_lines().size(), 1U) << outcome.err;
  EXPECT_THAT(outcome.error_lines().front(), AllOf(HasSubstr(file), HasSubstr(cause)));
  EXPECT_EQ(outcome.out, "");
}

const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

TEST(Input, MissingEmptyAndForeignFiles) {
  const Folder folder;
  expect_input_error(run_program({"solve", folder.file("none.obj")}), "none.obj", "No such file");
  expect_input_error(run_program({"solve", "/"}), "/", "not a scene format");
  std::filesystem::create_directory(folder.file("folder.obj"));
  expect_input_error(run_program({"solve", folder.file("folder.obj")}), "folder.obj", "folder");
  for (const char* name : {"empty.obj", "empty.xml", "empty.gltf", "empty.glb"}) {
    expect_input_error(run_program({"solve", folder.write(name, "")}), name, "");
  }
  expect_input_error(run_program({"solve", folder.write("x.stl", "solid")}), "x.stl", "not a scene format");
}

TEST(Input, NamesTheLine) {
  const Folder folder;
  expect_input_error(run_program({"solve", folder.write("a.obj", triangle + "f 1 2 9\n")}), "a.obj:4", "");
  expect_input_error(run_program({"solve", folder.write("b.obj", "v 0 0 nan\n" + triangle + "f 1 2 3\n")}), "b.obj:1",
                     "");
  expect_input_error(run_program({"solve", folder.write("c.xml", "<scene>\n<head>\n<objectdef")}), "c.xml:", "");
}

TEST(Input, ReflectanceAboveOneIsAnError) {
  const Folder folder;
  (void)folder.write("m.mtl", "newmtl bright\nKd 1.5 0 0\nKe 1 1 1\n");
  const std::string file = folder.write("a.obj", "mtllib m.mtl\n" + triangle + "usemtl bright\nf 1 2 3\n");
  expect_input_error(run_program({"solve", file}), "a.obj", "reflectance");
}

TEST(Input, NothingIsLeftBehindAfterAnError) {
  const Folder folder;
  const std::string file = folder.write("a.obj", triangle + "f 1 2 9\n");
  const Outcome outcome = run_program({"solve", file, "-o", folder.file("a.png"), "--report", folder.file("a.json")});
  EXPECT_EQ(outcome.status, 3);
  EXPECT_THAT(folder.names(), ElementsAre("a.obj"));
}

TEST(Input, AFullDiskLeavesNothing) {
  const Folder folder;
  // A limit on the size of files stands in for the full disk: the write fails in the same way.
  const std::string script = folder.write("run.sh", "trap '' XFSZ\nulimit -f 1\nexec \"$@\" 2>/dev/null >/dev/null\n");
  const std::string command = "bash '" + script + "' '" + INTERFLECT_PROGRAM + "' solve '" + scene_file("furnace.obj") +
                              "' --divide 0.01 -o '" + folder.file("out.csv") + "'";
  const int status = std::system(command.c_str());
  EXPECT_EQ(WEXITSTATUS(status), 3);
  EXPECT_THAT(folder.names(), ElementsAre("run.sh"));
}

TEST(Input, UnwritableOutputIsFoundBeforeTheWork) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("furnace.obj"), "--patches", "40000", "-o", folder.file("none/a.png")});
  EXPECT_EQ(outcome.status, 3);
  EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("none/a.png")));
}

TEST(Input, MemoryIsPredictedAndRefused) {
  const Outcome outcome =
      run_program({"solve", scene_file("furnace.obj"), "--patches", "12000"}, {"INTERFLECT_MEMORY=64M"});
  EXPECT_EQ(outcome.status, 6) << outcome.err;
  ASSERT_EQ(outcome.error_lines().size(), 1U);
  EXPECT_THAT(outcome.error_lines().front(), HasSubstr("--divide"));
}

TEST(Input, ThreadsThatNeedTheMemoryAreNamed) {
  const Outcome outcome = run_program({"solve", scene_file("furnace.obj"), "--divide", "1", "--device", "openmp"},
                                      {"INTERFLECT_MEMORY=100M", "OMP_NUM_THREADS=3000", "OMP_THREAD_LIMIT=2"});
  EXPECT_EQ(outcome.status, 6) << outcome.err;
  EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("set OMP_NUM_THREADS to at most 9")));
}

TEST(Input, NoFileOfTheSceneIsAnOutput) {
  const Folder folder;
  const std::string material = "newmtl grey\nKd 0.5 0.5 0.5\nKe 1 1 1\n";
  (void)folder.write("m.mtl", material);
  const std::string scene = folder.write("a.obj", "mtllib m.mtl\n" + triangle + "usemtl grey\nf 1 2 3\n");
  const Outcome outcome = run_program({"solve", scene, "--report", folder.file("./m.mtl")});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("belongs to the scene")));
  EXPECT_EQ(content_of(folder.file("m.mtl")), material);
}

TEST(Input, TheSceneIsNeverAnOutput) {
  const Folder folder;
  const std::string scene = folder.write("a.glb", "not read");
  const std::string link = folder.file("link.glb");
  std::filesystem::create_symlink("a.glb", link);
  for (const std::string& output : {scene, link, folder.file("./a.glb")}) {
    const Outcome outcome = run_program({"solve", scene, "-o", output});
    EXPECT_EQ(outcome.status, 2) << output;
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("is the scene")));
  }
  EXPECT_EQ(content_of(scene), "not read");
}

TEST(Input, APictureThatWillNotFitIsALimit) {
  const Outcome outcome =
      run_program({"solve", scene_file("furnace.obj"), "--divide", "1", "--size", "16384x16384", "-o", "x.png"},
                  {"INTERFLECT_MEMORY=1G"});
  EXPECT_EQ(outcome.status, 6);
  EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("--size")));
}

TEST(Input, HugeEmittanceNamesTheMaterial) {
  const Folder folder;
  (void)folder.write("m.mtl", "newmtl sun\nKd 0.5 0 0\nKe 1e300 1 1\n");
  const std::string file = folder.write("a.obj", "mtllib m.mtl\n" + triangle + "usemtl sun\nf 1 2 3\n");
  expect_input_error(run_program({"solve", file}), "a.obj", "'sun'");
}

TEST(Input, BenchFindsAnUnwritableFileBeforeTheWork) {
  const Folder folder;
  for (const char* option : {"--json", "--csv", "--plot"}) {
    const Outcome outcome = run_program({"bench", option, folder.file("none/a.svg"), "--scenes", folder.file("")});
    EXPECT_EQ(outcome.status, 3);
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr("none/a.svg")));
    EXPECT_EQ(outcome.out, "");
  }
}

TEST(Input, TooManyPatchesIsALimit) {
  const Outcome outcome = run_program({"solve", scene_file("furnace.obj"), "--divide", "1e-12"});
  EXPECT_EQ(outcome.status, 6) << outcome.err;
}

}  // namespace
}  // namespace interflect::test
