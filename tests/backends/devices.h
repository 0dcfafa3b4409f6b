#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "interflect/device/registry.h"

namespace interflect::test {

/// The ids that the tests of all backends are run with; a test of one that is not there is skipped, and says why.
inline constexpr const char* tested_devices[] = {"openmp", "opencl:0", "vulkan:0", "cuda:0"};

/// A test's name for an id: "opencl:0" is opencl_0.
inline std::string test_name(const testing::TestParamInfo<const char*>& info) {
  std::string name = info.param;
  for (char& c : name) c = c == ':' ? '_' : c;
  return name;
}

/// Why the device cannot be opened; empty when it can.
inline std::string why_unavailable(const std::string& id) {
  for (const DeviceEntry& entry : list_devices()) {
    if (entry.info.id == id) return entry.available ? "" : entry.reason;
  }
  return "no such device";
}

/// Whether INTERFLECT_TEST_REQUIRE ("opencl:0,vulkan:0") says that the device must be there: then a test of one that is
/// not fails instead of being skipped.
inline bool required(const std::string& id) {
  const char* list = std::getenv("INTERFLECT_TEST_REQUIRE");
  return list != nullptr && fmt::format(",{},", list).find(fmt::format(",{},", id)) != std::string::npos;
}

/// A test on one device, given by its id.
class OnDevice : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    const std::string why = why_unavailable(GetParam());
    if (!why.empty() && required(GetParam())) FAIL() << GetParam() << ": " << why;
    if (!why.empty()) GTEST_SKIP() << GetParam() << ": " << why;
    device = open_device(GetParam());
  }
  std::unique_ptr<Device> device;
};

}  // namespace interflect::test
