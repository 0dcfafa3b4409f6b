// What the Vulkan backend makes of a device's properties and of the API's errors; needs no driver.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "interflect/device/vulkan/api.h"

namespace interflect {
namespace {

using testing::HasSubstr;

/// A device as its driver might describe it.
vulkan::Adapter adapter_of(vk::PhysicalDeviceType type, std::uint32_t subgroup, bool adds) {
  vulkan::Adapter adapter;
  adapter.properties.deviceType = type;
  vk::PhysicalDeviceLimits& limits = adapter.properties.limits;
  limits.maxComputeWorkGroupInvocations = limits.maxComputeWorkGroupSize[0] = 1024;
  limits.maxComputeSharedMemorySize = 16384;
  limits.maxPerStageDescriptorStorageBuffers = limits.maxDescriptorSetStorageBuffers = limits.maxPerStageResources = 7;
  adapter.subgroup.subgroupSize = subgroup;
  adapter.subgroup.supportedStages = vk::ShaderStageFlagBits::eCompute;
  if (adds) adapter.subgroup.supportedOperations = vk::SubgroupFeatureFlagBits::eArithmetic;
  return adapter;
}

TEST(VulkanShape, FollowsTheDevicesProperties) {
  using Type = vk::PhysicalDeviceType;
  const vulkan::Shape cpu = vulkan::choose_shape(adapter_of(Type::eCpu, 8, true));
  EXPECT_TRUE(cpu.texel);
  EXPECT_FALSE(cpu.staged);
  EXPECT_EQ(cpu.workgroup, 8U);
  EXPECT_EQ(cpu.subgroups, 1U);
  const vulkan::Shape gpu = vulkan::choose_shape(adapter_of(Type::eDiscreteGpu, 32, true));
  EXPECT_FALSE(gpu.texel);
  EXPECT_TRUE(gpu.staged);
  EXPECT_EQ(gpu.workgroup, 256U);
  EXPECT_EQ(gpu.subgroups, 8U);
  vulkan::Adapter varying = adapter_of(Type::eIntegratedGpu, 32, true);
  varying.smallest_subgroup = 8;
  varying.largest_subgroup = 32;
  const vulkan::Shape integrated = vulkan::choose_shape(varying);
  EXPECT_FALSE(integrated.staged);
  EXPECT_EQ(integrated.subgroups, 32U) << "a subgroup may have 8";
  EXPECT_EQ(vulkan::choose_shape(adapter_of(Type::eDiscreteGpu, 64, false)).subgroups, 0U);
}

TEST(VulkanShape, ALimitThatIsTooLowIsNamed) {
  const auto expect_missing = [&](std::uint32_t vk::PhysicalDeviceLimits::*limit, std::uint32_t value,
                                  const char* words) {
    vulkan::Adapter poor = adapter_of(vk::PhysicalDeviceType::eDiscreteGpu, 32, true);
    poor.shape = vulkan::choose_shape(poor);
    EXPECT_EQ(vulkan::missing_limit(poor), "");
    poor.properties.limits.*limit = value;
    EXPECT_THAT(vulkan::missing_limit(poor), HasSubstr(words));
  };
  using Limits = vk::PhysicalDeviceLimits;
  expect_missing(&Limits::maxPerStageDescriptorStorageBuffers, 4, "maxPerStageDescriptorStorageBuffers is 4, 7 is");
  expect_missing(&Limits::maxPerStageResources, 6, "maxPerStageResources is 6");
  expect_missing(&Limits::maxComputeWorkGroupInvocations, 128, "maxComputeWorkGroupInvocations is 128, 256 is");
  expect_missing(&Limits::maxComputeSharedMemorySize, 8192, "maxComputeSharedMemorySize is 8192");
  vulkan::Adapter small = adapter_of(vk::PhysicalDeviceType::eDiscreteGpu, 32, true);
  small.properties.limits.maxComputeWorkGroupInvocations = 192;
  EXPECT_EQ(vulkan::choose_shape(small).workgroup, 128U) << "a power of two";
}

TEST(VulkanErrors, AreNamedAsInTheApi) {
  EXPECT_EQ(vulkan::text(vk::Result::eErrorOutOfDeviceMemory), "VK_ERROR_OUT_OF_DEVICE_MEMORY (-2)");
  EXPECT_EQ(vulkan::text(vk::Result::eErrorDeviceLost), "VK_ERROR_DEVICE_LOST (-4)");
  EXPECT_EQ(vulkan::text(vk::Result::eErrorSurfaceLostKHR), "VK_ERROR_SURFACE_LOST_KHR (-1000000000)");
}

}  // namespace
}  // namespace interflect
