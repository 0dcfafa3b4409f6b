// The shadow rays of OpenCL and Vulkan in both shapes, packets and single rays, and broken ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "backends/devices.h"
#include "device/kernel_folder.h"
#include "interflect/device/check_tools.h"

namespace interflect {
namespace {

using Shape = std::pair<const char*, const char*>;  ///< a device's id, and what its kernels are shaped for

class ShapedRays : public testing::TestWithParam<Shape> {
 protected:
  void SetUp() override {
    if (const std::string why = test::why_unavailable(id()); !why.empty()) GTEST_SKIP() << why;
  }
  [[nodiscard]] static std::string id() { return GetParam().first; }
  [[nodiscard]] static std::vector<KernelCheck> check(std::uint64_t max_size) {
    std::vector<KernelCheck> rows;
    check::check_rays(*open_device(id()), rows, {.max_size = max_size});
    return rows;
  }

 private:
  test::Variable opencl_{"INTERFLECT_OPENCL_SHAPE", GetParam().second};
  test::Variable vulkan_{"INTERFLECT_VULKAN_SHAPE", GetParam().second};
};
INSTANTIATE_TEST_SUITE_P(All, ShapedRays,
                         testing::Values(Shape{"opencl:0", "cpu"}, Shape{"opencl:0", "gpu"}, Shape{"vulkan:0", "cpu"},
                                         Shape{"vulkan:0", "gpu"}),
                         [](const auto& info) { return std::string(info.param.first, 6) + "_" + info.param.second; });

TEST_P(ShapedRays, AgreeWithTheReference) {
  const test::FreshCache cache;
  const std::vector<KernelCheck> rows = check(every_size);
  EXPECT_GE(rows.size(), 22U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << row.parameters << " " << row.reason;
}

void expect_seen(const std::vector<KernelCheck>& rows, const char* what) {
  EXPECT_TRUE(std::any_of(rows.begin(), rows.end(), [](const auto& r) { return r.status == CheckStatus::fail; }))
      << what;
}

/// Packets and single rays have a text of their own for this.
TEST_P(ShapedRays, BrokenBoxesFail) {
  test::KernelFolder folder;
  folder.replace("shared/occluded.h", "bytes_of(up_x ? high.x : low.x) * step_x",
                 "bytes_of(up_x ? high.x : low.x) * 0.9f * step_x");
  folder.replace("shared/occluded.h", "y - wy), larger(z - wz", "y), larger(z - wz");
  expect_seen(check(300), "boxes");
}

TEST_P(ShapedRays, BrokenTrianglesFail) {
  if (GetParam().second == std::string("cpu")) GTEST_SKIP() << "the text is that of the GPUs' shape";
  constexpr std::pair<const char*, const char*> defects[] = {
      {"area * r.far - along", "area * 100.0f - along"},
      {"az.w, bx.w, by.w, bz.w, cx.w, cy.w, cz.w)", "az.x, bx.x, by.x, bz.x, cx.x, cy.x, cz.x)"}};
  for (const auto& [from, to] : defects) {
    test::KernelFolder folder;
    folder.replace("shared/occluded.h", from, to);
    expect_seen(check(300), to);
  }
}

}  // namespace
}  // namespace interflect
