#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <optional>

#include "interflect/device/vulkan/api.h"

namespace interflect::vulkan {

namespace {

/// INTERFLECT_VULKAN_SUBGROUP, if it is set.
std::optional<std::uint32_t> wanted_subgroup(const Adapter& adapter) {
  const std::string_view value = variable("INTERFLECT_VULKAN_SUBGROUP");
  if (value.empty()) return std::nullopt;
  if (value == "0") return 0;
  std::string allowed = "0";
  for (std::uint32_t size = adapter.smallest_subgroup; size != 0 && size <= adapter.largest_subgroup; size *= 2) {
    if (value == std::to_string(size)) return size;
    allowed += fmt::format(" or {}", size);
  }
  throw fmt::format("INTERFLECT_VULKAN_SUBGROUP: '{}' must be {} on this device", value, allowed);
}

/// A power of two: the tree of group_sum.comp halves it.
std::uint32_t largest_workgroup(const vk::PhysicalDeviceLimits& limits) {
  return std::bit_floor(std::min({256U, limits.maxComputeWorkGroupInvocations, limits.maxComputeWorkGroupSize[0]}));
}

}  // namespace

Shape choose_shape(const Adapter& adapter) {
  const vk::PhysicalDeviceLimits& limits = adapter.properties.limits;
  const auto type = adapter.properties.deviceType;
  const auto wanted = wanted_subgroup(adapter);
  const bool adds = wanted != 0U && (adapter.subgroup.supportedStages & vk::ShaderStageFlagBits::eCompute) &&
                    (adapter.subgroup.supportedOperations & vk::SubgroupFeatureFlagBits::eArithmetic);
  const std::uint32_t size = wanted.value_or(0) != 0 ? *wanted : adapter.subgroup.subgroupSize;

  const std::string_view forced = variable("INTERFLECT_VULKAN_SHAPE");
  if (!forced.empty() && forced != "cpu" && forced != "gpu") {
    throw fmt::format("INTERFLECT_VULKAN_SHAPE: '{}' is neither cpu nor gpu", forced);
  }
  Shape shape;
  shape.texel = forced.empty() ? type == vk::PhysicalDeviceType::eCpu && size < 16 : forced == "cpu";
  shape.staged =
      forced == "gpu" || (type != vk::PhysicalDeviceType::eCpu && type != vk::PhysicalDeviceType::eIntegratedGpu);
  shape.subgroup = wanted.value_or(0);
  shape.workgroup = shape.texel ? std::max(4U, size) : largest_workgroup(limits);  // four invocations share a tile
  shape.rows = shape.texel ? 12 : 8;
  shape.chunk = shape.texel ? 3 : 4;
  if (adds) {
    const std::uint32_t smallest =
        shape.subgroup != 0 || adapter.smallest_subgroup == 0 ? size : adapter.smallest_subgroup;
    shape.subgroups = std::max(1U, shape.workgroup / smallest);
    shape.shuffles = shape.texel && shape.subgroups == 1 &&
                     (adapter.subgroup.supportedOperations & vk::SubgroupFeatureFlagBits::eShuffle);
  }
  return shape;
}

namespace {

/// The most buffers that a kernel takes.
std::uint32_t most_buffers() {
  std::size_t most = 0;
  for (const KernelLine& line : kernel_table()) most = std::max(most, line.access.size());
  return static_cast<std::uint32_t>(most);
}

/// The most bytes that a kernel keeps in shared memory: group_sum.comp, and beside it at most 2048 floats of
/// matvec.comp where a work-group has several subgroups; or sym16.comp: 128 strips of 4 words, and where eight
/// invocations exchange values, one word more for each, else their sums of 4 or 8 rows and 8 parts of each row's.
std::uint32_t shared_bytes(const Shape& shape) {
  const std::uint32_t sums = shape.subgroups == 1 ? 0 : shape.subgroups == 0 ? shape.workgroup : 2048 + shape.subgroups;
  const std::uint32_t rows =
      shape.shuffles && shape.workgroup == 8 ? 128 : sym16_chunk * ((shape.texel ? 8 : 4) * shape.workgroup + 64);
  return std::max(sums, 512 + rows) * 4;
}

}  // namespace

std::string missing_limit(const Adapter& adapter) {
  const vk::PhysicalDeviceLimits& limits = adapter.properties.limits;
  struct Line {
    const char* name;
    std::uint32_t has, needs;
  };
  const std::uint32_t buffers = most_buffers(), workgroup = adapter.shape.workgroup;
  const Line lines[] = {
      {"maxPerStageDescriptorStorageBuffers", limits.maxPerStageDescriptorStorageBuffers, buffers},
      {"maxDescriptorSetStorageBuffers", limits.maxDescriptorSetStorageBuffers, buffers},
      {"maxPerStageResources", limits.maxPerStageResources, buffers},
      {"maxComputeWorkGroupInvocations", limits.maxComputeWorkGroupInvocations, workgroup},
      {"maxComputeWorkGroupSize", limits.maxComputeWorkGroupSize[0], workgroup},
      {"maxComputeSharedMemorySize", limits.maxComputeSharedMemorySize, shared_bytes(adapter.shape)},
  };
  for (const Line& line : lines) {
    if (line.has < line.needs) {
      return fmt::format("the device's limit {} is {}, {} is needed", line.name, line.has, line.needs);
    }
  }
  return {};
}

}  // namespace interflect::vulkan
