#include "program.h"

#include <gtest/gtest.h>

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

}  // namespace interflect::test
