#include "program.h"

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace interflect::test {

TEST(Program, NamesItsVersionAndItsCommands) {
  EXPECT_EQ(run_program({"--version"}).status, 0);
  const Outcome help = run_program({"--help"});
  EXPECT_EQ(help.status, 0);
  for (const char* command : {"solve", "formfactors", "devices", "check", "bench"}) {
    EXPECT_NE(help.out.find(command), std::string::npos) << command;
    EXPECT_EQ(run_program({command, "--help"}).status, 0) << command;
  }
}

/// The exit status of a solve whose streams the shell has closed or turned elsewhere.
int status_with(const Folder& folder, const std::string& name, const std::string& streams) {
  const std::string command = std::string("'") + INTERFLECT_PROGRAM + "' solve '" + scene_file("furnace.obj") +
                              "' --divide 0.2 --device openmp --json-progress --form-factors '" +
                              folder.file(name + ".iff") + "' -o '" + folder.file(name + ".csv") + "' " + streams;
  const int status = std::system(command.c_str());  // NOLINT: names of our own
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

TEST(Program, WritesNothingElseIntoItsFilesWhereStreamsAreClosed) {
  const Folder folder;
  EXPECT_EQ(status_with(folder, "open", ">/dev/null 2>/dev/null"), 0);
  EXPECT_EQ(status_with(folder, "quiet", ">/dev/null 2>&-"), 0);
  EXPECT_EQ(status_with(folder, "closed", "<&- >&- 2>&-"), 3);  // its summary cannot be printed
  for (const char* name : {"quiet", "closed"}) {
    for (const char* extension : {".iff", ".csv"}) {
      EXPECT_TRUE(content_of(folder.file(std::string(name) + extension)) ==
                  content_of(folder.file(std::string("open") + extension)))
          << name << extension;
    }
  }
}

}  // namespace interflect::test
