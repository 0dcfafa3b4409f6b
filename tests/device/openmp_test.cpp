#include "interflect/device/openmp/openmp.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>

#include "device/expect_error.h"
#include "interflect/base/error.h"
#include "interflect/device/openmp/simd.h"
#include "interflect/device/registry.h"

namespace interflect {
namespace {

using testing::AllOf;
using testing::HasSubstr;

using test::expect_error;

class OpenMP : public testing::Test {
 protected:
  std::unique_ptr<Device> device = open_device("openmp");
};

TEST_F(OpenMP, StatesWhatItIs) {
  const DeviceInfo& info = device->info();
  EXPECT_EQ(info.id, "openmp");
  EXPECT_EQ(info.backend, "openmp");
  EXPECT_EQ(info.type, DeviceType::cpu);
  EXPECT_FALSE(info.name.empty());
  EXPECT_THAT(info.driver, AllOf(HasSubstr("OpenMP"), HasSubstr(openmp::simd_target())));
  EXPECT_GT(info.memory_bytes, std::uint64_t{1} << 20);
  EXPECT_EQ(info.compute_units, static_cast<std::uint32_t>(omp_get_max_threads()));
}

TEST(SimdTarget, AnUnknownNameIsAUsageErrorThatListsTheValidOnes) {
  expect_error(ErrorKind::usage, AllOf(HasSubstr("'AVX9'"), HasSubstr(openmp::simd_targets().back())),
               [] { openmp::use_simd_target("AVX9"); });
}

/// Opens the device in a fresh process with INTERFLECT_SIMD set; exits with 0 when it uses that target, 2 for an Error.
[[noreturn]] void open_with(const std::string& target) {
  ::setenv("INTERFLECT_SIMD", target.c_str(), 1);
  try {
    const auto device = open_device("openmp");
    std::exit(openmp::simd_target() == target && device->info().driver.ends_with(target) ? 0 : 1);
  } catch (const Error& error) {
    std::fputs(error.what(), stderr);
    std::exit(exit_status(error.kind()));
  }
}

TEST(SimdTargetDeathTest, TheEnvironmentNamesOne) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(open_with(openmp::simd_targets().back()), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(open_with("AVX9"), testing::ExitedWithCode(2), "INTERFLECT_SIMD: 'AVX9'");
}

}  // namespace
}  // namespace interflect
