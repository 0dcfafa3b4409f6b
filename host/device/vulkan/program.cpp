#include "interflect/device/vulkan/program.h"

#include <fmt/format.h>

#include <cstring>

namespace interflect::vulkan {

namespace {

/// Whether a buffer of the kernel is declared with INPUT_FOURS (kernels/glsl/fours.comp).
bool reads_fours(std::string_view kernel, std::size_t buffer) {
  return kernel == "matvec" ? buffer < 2 : (kernel == "read" || kernel == "copy") && buffer == 0;
}

std::uint32_t chunk_columns(std::uint32_t columns, std::uint32_t largest) {
  const std::uint32_t chunks = (columns + largest - 1) / largest;
  return (columns + chunks - 1) / chunks;
}

}  // namespace

std::string preamble(const FoundKernel& found, const Shape& shape) {
  std::string out = "#version 450\n#extension GL_GOOGLE_cpp_style_line_directive : require\n";
  if (shape.subgroups != 0) {
    out +=
        "#extension GL_KHR_shader_subgroup_basic : require\n"
        "#extension GL_KHR_shader_subgroup_arithmetic : require\n";
  }
  const auto define = [&out](std::string_view name, std::uint32_t value) {
    out += fmt::format("#define {} {}\n", name, value);
  };
  out += fmt::format("#define KERNEL_{}\n#define WORKGROUP {}\n", found.line->name, shape.workgroup);
  if (shape.subgroups != 0) out += fmt::format("#define SUBGROUPS {}\n", shape.subgroups);
  if (shape.texel) out += "#define TEXEL\n";
  for (const auto& [macro, value] : found.macros) define(macro, static_cast<std::uint32_t>(value));
  if (const auto columns = found.macros.find("COLUMNS"); columns != found.macros.end()) {
    define("CHUNK", chunk_columns(static_cast<std::uint32_t>(columns->second), shape.chunk));
  }
  return out;
}

Program::Program(const FoundKernel& found, const Context& context, std::span<const std::byte> binary) {
  const KernelLine& line = *found.line;
  using Stage = vk::ShaderStageFlagBits;
  std::vector<vk::DescriptorSetLayoutBinding> bindings;
  for (std::uint32_t i = 0; i < line.access.size(); ++i) {
    const bool texel = context.adapter.shape.texel && reads_fours(line.name, i);
    types.push_back(texel ? vk::DescriptorType::eStorageTexelBuffer : vk::DescriptorType::eStorageBuffer);
    bindings.emplace_back(i, types.back(), 1, Stage::eCompute);
  }
  if (const auto columns = found.macros.find("COLUMNS"); columns != found.macros.end()) {
    const auto count = static_cast<std::uint32_t>(columns->second);
    const std::uint32_t chunk = chunk_columns(count, context.adapter.shape.chunk);
    chunks = (count + chunk - 1) / chunk;
  }
  set_layout = {context.device, vk::DescriptorSetLayoutCreateInfo({}, bindings)};
  const vk::PushConstantRange range(Stage::eCompute, 0, static_cast<std::uint32_t>(line.argument_bytes));
  layout = {context.device, vk::PipelineLayoutCreateInfo({}, *set_layout, range)};

  std::vector<std::uint32_t> words(binary.size() / sizeof(std::uint32_t));
  std::memcpy(words.data(), binary.data(), words.size() * sizeof(std::uint32_t));
  const vk::raii::ShaderModule module(context.device, vk::ShaderModuleCreateInfo({}, words));
  vk::PipelineShaderStageCreateInfo stage({}, Stage::eCompute, *module, "main");
  const vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo size(context.adapter.shape.subgroup);
  if (context.adapter.shape.subgroup != 0) stage.setPNext(&size);
  pipeline = {context.device, nullptr, vk::ComputePipelineCreateInfo({}, stage, *layout)};
}

}  // namespace interflect::vulkan
