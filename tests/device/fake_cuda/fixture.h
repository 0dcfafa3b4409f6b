#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "device/fake_cuda/fake_cuda.h"

namespace interflect::test {

/// A test on the fake driver: one GPU, nothing fails, a cache of its own.
class FakeCuda : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) /
              ("fake_cuda_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + "_" +
               std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
    ::setenv("XDG_CACHE_HOME", folder_.c_str(), 1);
    ::setenv("INTERFLECT_NVRTC", FAKE_CUDA_FOLDER "/libnvrtc.so", 1);
    fake_cuda_devices(1);
    fake_cuda_reset();
  }
  void TearDown() override {
    for (const char* name :
         {"XDG_CACHE_HOME", "INTERFLECT_NVRTC", "INTERFLECT_KERNEL_DIR", "FAKE_CUDA_INIT", "INTERFLECT_CUDA_GRAPH"})
      ::unsetenv(name);
    std::filesystem::remove_all(folder_);
  }

  /// Runs the program on the fake driver; its output and, after a line "STATUS n", what the driver reports.
  std::string program(const std::string& environment, const std::string& arguments) const {
    const std::string report = (folder_ / "report").string();
    const std::string output = (folder_ / "output").string();
    const std::string command = "LD_LIBRARY_PATH=" FAKE_CUDA_FOLDER " FAKE_CUDA_REPORT='" + report + "' " +
                                environment + " " INTERFLECT_PROGRAM " " + arguments + " > '" + output + "' 2>&1";
    const int status = std::system(command.c_str());
    return text(output) + "\nSTATUS " + std::to_string(WEXITSTATUS(status)) + "\n" + text(report);
  }
  static std::string text(const std::filesystem::path& path) {
    std::ostringstream all;
    all << std::ifstream(path).rdbuf();
    return all.str();
  }

  std::filesystem::path folder_;
};

inline std::string report() {
  return fake_cuda_report();
}
inline void expect_nothing_left() {
  EXPECT_THAT(report(), testing::HasSubstr("live=0\n"));
  EXPECT_THAT(report(), testing::Not(testing::HasSubstr("broken")));
}

}  // namespace interflect::test
