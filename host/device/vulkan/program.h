#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "interflect/device/kernel_table.h"
#include "interflect/device/vulkan/api.h"

namespace interflect::vulkan {

/// What stands before a kernel's source: version, extensions, the macros of the kernel and those of the device's shape.
[[nodiscard]] std::string preamble(const FoundKernel& found, const Shape& shape);

/// A kernel as the driver has compiled it, shared by all Kernels of the same name and macros.
struct Program {
  /// binary: SPIR-V. Throws vk::SystemError.
  Program(const FoundKernel& found, const Context& context, std::span<const std::byte> binary);

  std::vector<vk::DescriptorType> types;  ///< of the buffers
  std::vector<vk::Format> texels;         ///< of those that are read by texels, else undefined
  std::uint32_t chunks = 1;               ///< of matvec's columns: work-groups side by side
  vk::raii::DescriptorSetLayout set_layout = nullptr;
  vk::raii::PipelineLayout layout = nullptr;
  vk::raii::Pipeline pipeline = nullptr;
};

}  // namespace interflect::vulkan
