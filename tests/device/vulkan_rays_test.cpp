#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "device/kernel_folder.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/vulkan/vulkan.h"

// The Vulkan shadow rays in every shape, and broken ones.

namespace interflect {
namespace {

class VulkanRays : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    std::string why;
    for (const DeviceEntry& entry : vulkan::list_devices()) {
      if (entry.available) return;
      why = entry.reason;
      ++index_;
    }
    GTEST_SKIP() << "no Vulkan device: " << why;
  }
  [[nodiscard]] std::vector<KernelCheck> check(std::uint64_t max_size) const {
    std::vector<KernelCheck> rows;
    check::check_rays(*vulkan::open_device(index_), rows, {.max_size = max_size});
    return rows;
  }

 private:
  std::uint32_t index_ = 0;
  test::Variable validation_{"INTERFLECT_VULKAN_VALIDATION", "1"};
  test::Variable shape_{"INTERFLECT_VULKAN_SHAPE", GetParam()};
};
INSTANTIATE_TEST_SUITE_P(Shape, VulkanRays, testing::Values("cpu", "gpu"),
                         [](const auto& shape) { return std::string(shape.param); });

TEST_P(VulkanRays, AgreeWithTheReference) {
  const test::FreshCache cache;
  const std::vector<KernelCheck> rows = check(every_size);
  EXPECT_GE(rows.size(), 22U);
  for (const KernelCheck& row : rows) EXPECT_EQ(row.status, CheckStatus::pass) << row.parameters << " " << row.reason;
}

TEST_P(VulkanRays, BrokenOnesFail) {
  struct Defect {
    const char *from, *to, *from_of_packets = nullptr, *to_of_packets = nullptr;
  };
  for (const Defect d :
       {Defect{"bytes_of(up_x ? high.x : low.x) * step_x", "bytes_of(up_x ? high.x : low.x) * 0.9f * step_x",
               "y - wy), larger(z - wz", "y), larger(z - wz"},
        Defect{"area * r.far - along", "area * 100.0f - along"},
        Defect{"az.w, bx.w, by.w, bz.w, cx.w, cy.w, cz.w)", "az.x, bx.x, by.x, bz.x, cx.x, cy.x, cz.x)"}}) {
    test::KernelFolder folder;
    folder.replace("shared/occluded.h", d.from, d.to);
    if (d.from_of_packets != nullptr) folder.replace("shared/occluded.h", d.from_of_packets, d.to_of_packets);
    const std::vector<KernelCheck> rows = check(300);
    EXPECT_TRUE(std::any_of(rows.begin(), rows.end(), [](const auto& r) { return r.status == CheckStatus::fail; }))
        << d.to;
  }
}

}  // namespace
}  // namespace interflect
