// `view` and `solve -o x.html`: which lamps a page has, where it lies, how it fails. What it shows: tests/browser.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

/// Two plates that light each other from within a folder of the test's own, with two lamps.
std::string scene_in(const Folder& folder) {
  (void)folder.write("m.mtl", "newmtl warm\nKd 0.5 0.5 0.5\nKe 2 1 0.5\nnewmtl cold\nKd 0.5 0.5 0.5\nKe 0.5 1 2\n");
  return folder.write("plates.obj",
                      "mtllib m.mtl\nv 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 1 1 1\nv 0 1 1\n"
                      "o lower\nusemtl warm\nf 1 2 3 4\no upper\nusemtl cold\nf 5 6 7 8\n");
}

json description_of(const std::string& page) {
  const std::string start = "id=\"description\">";
  const std::size_t from = page.find(start) + start.size();
  return json::parse(page.substr(from, page.find("</script>", from) - from));
}

Outcome run_on_openmp(std::vector<std::string> arguments) {
  arguments.insert(arguments.end(), {"--divide", "0.05", "--device", "openmp"});
  return run_program(arguments);
}

TEST(View, WritesAPageAndSaysWhere) {
  const Folder folder;
  const std::string scene = scene_in(folder), page = folder.file("a page.html");
  const Outcome outcome = run_on_openmp({"view", scene, "-o", page, "-o", folder.file("b.csv")});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out,
              HasSubstr("\nopen           " + std::filesystem::path(page).lexically_normal().string() + "\n"));
  EXPECT_THAT(folder.names(), UnorderedElementsAre("m.mtl", "plates.obj", "a page.html", "b.csv"));
  const json description = description_of(content_of(page));
  EXPECT_EQ(description.at("title"), "plates");
  EXPECT_EQ(description.at("lamps"), json::array({"lower", "upper"}));
  EXPECT_EQ(description.at("bounces"), 13);
  EXPECT_EQ(description.at("surfaces")[0], json({"lower", "warm"}));
  std::vector<std::string> names;
  for (const json& line : description.at("statistics")) names.push_back(line.at(0));
  EXPECT_THAT(names, ::testing::IsSupersetOf({"Patches", "Method", "Products", "Solve", "Device", "Residual"}));
}

TEST(View, WithoutANameTakesTheScenes) {
  const Folder folder;
  (void)scene_in(folder);
  const std::string command = "cd '" + folder.file("") + "' && '" + INTERFLECT_PROGRAM +
                              "' view plates.obj --divide 0.05 --device openmp --quiet 2>/dev/null";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_THAT(folder.names(), UnorderedElementsAre("m.mtl", "plates.obj", "plates.html"));
}

TEST(View, TellsLampsApartAsAsked) {
  const Folder folder;
  const std::string scene = scene_in(folder), page = folder.file("a.html");
  const auto lamps = [&](const std::vector<std::string>& arguments) {
    std::vector<std::string> all{"solve", scene, "-o", page, "--quiet"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Outcome outcome = run_on_openmp(all);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return description_of(content_of(page)).at("lamps");
  };
  EXPECT_EQ(lamps({}), json::array({"lower", "upper"}));
  EXPECT_EQ(lamps({"--light-groups", "material"}), json::array({"warm", "cold"}));
  EXPECT_EQ(lamps({"--light-groups", "none"}), json::array({"All lamps"}));
}

TEST(View, SaysInThePageThatItIsNotConverged) {
  const Folder folder;
  const std::string page = folder.file("a.html");
  const Outcome outcome = run_on_openmp({"view", scene_in(folder), "-o", page, "--max-iterations", "1"});
  EXPECT_EQ(outcome.status, 5);
  EXPECT_THAT(description_of(content_of(page)).at("statistics").dump(), HasSubstr("NOT CONVERGED"));
  EXPECT_EQ(description_of(content_of(page)).at("incomplete"), true);
}

TEST(View, SaysInThePageThatBouncesAreMissing) {
  const Folder folder;
  const std::string page = folder.file("a.html");
  const auto incomplete = [&](const std::string& iterations) {
    const Outcome outcome = run_on_openmp(
        {"view", scene_in(folder), "-o", page, "--method", "jacobi", "--iterations", iterations, "--quiet"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return description_of(content_of(page)).contains("incomplete");
  };
  EXPECT_TRUE(incomplete("2"));
  EXPECT_FALSE(incomplete("100"));  // which is all that single precision can tell
}

TEST(View, AFullDiskLeavesNothing) {
  const Folder folder;
  // A limit on the size of files stands in for the full disk: the write fails in the same way.
  const std::string script =
      folder.write("run.sh", "trap '' XFSZ\nulimit -f 100\nexec \"$@\" 2>'" + folder.file("said") + "' >/dev/null\n");
  const std::string page = folder.file("a.html");
  const std::string command = "bash '" + script + "' '" + INTERFLECT_PROGRAM + "' view '" + scene_file("furnace.obj") +
                              "' --divide 0.1 --device openmp -o '" + page + "'";
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 3);
  EXPECT_THAT(content_of(folder.file("said")), HasSubstr(page));
  EXPECT_THAT(folder.names(), UnorderedElementsAre("run.sh", "said"));
}

TEST(View, RefusesWhatIsNoPageBeforeTheWork) {
  const Folder folder;
  const std::string scene = scene_in(folder);
  const Outcome other = run_program({"view", scene, "-o", folder.file("a.png")});
  EXPECT_EQ(other.status, 2);
  EXPECT_THAT(other.error_lines(), ElementsAre(HasSubstr("which ends in .html")));
  const Outcome missing = run_program({"view", scene, "-o", folder.file("none/a.html")});
  EXPECT_EQ(missing.status, 3);
  EXPECT_THAT(missing.error_lines(), ElementsAre(HasSubstr("none/a.html")));
  EXPECT_THAT(folder.names(), UnorderedElementsAre("m.mtl", "plates.obj"));
}

}  // namespace
}  // namespace interflect::test
