#include "interflect/device/vulkan/program.h"

#include <fmt/format.h>

#include <cstring>

namespace interflect::vulkan {

namespace {

/// The texels of a buffer that the kernel declares with INPUT_FOURS or INPUT_WORDS (kernels/glsl/fours.comp);
/// undefined: it is a storage buffer.
vk::Format texels_of(std::string_view kernel, std::size_t buffer) {
  constexpr vk::Format fours = vk::Format::eR32G32B32A32Sfloat, words = vk::Format::eR32G32B32A32Uint;
  if (kernel == "tiles16" || kernel == "sym16") {
    return buffer < 2 ? words : buffer == 2 || kernel == "sym16" ? fours : vk::Format::eUndefined;
  }
  if (kernel.starts_with("tile_")) {
    if (kernel == "tile_rays" && buffer == 5) return fours;
    return buffer < 2 || (kernel == "tile_rays" && buffer == 4) ? words : vk::Format::eUndefined;
  }
  if (kernel == "shadow_rays" && buffer < 3) return buffer == 0 ? words : fours;
  const bool reads = kernel == "matvec" || kernel == "matvec_exact"
                         ? buffer < 2
                         : (kernel == "read" || kernel == "copy" || kernel == "sym16_fold") && buffer == 0;
  return reads ? fours : vk::Format::eUndefined;
}

/// Columns of x for one work-group, and how many work-groups lie side by side.
struct Chunks {
  std::uint32_t columns = 1, count = 1;
};
Chunks chunks_of(const FoundKernel& found, const Shape& shape) {
  const auto macro = found.macros.find("COLUMNS");
  if (macro == found.macros.end()) return {};
  const auto columns = static_cast<std::uint32_t>(macro->second);
  const std::uint32_t largest = found.line->name == "sym16" ? sym16_chunk : shape.chunk;
  const std::uint32_t count = (columns + largest - 1) / largest;
  const std::uint32_t size = (columns + count - 1) / count;
  return {size, (columns + size - 1) / size};
}

}  // namespace

std::string preamble(const FoundKernel& found, const Shape& shape) {
  std::string out = "#version 450\n#extension GL_GOOGLE_cpp_style_line_directive : require\n";
  if (shape.subgroups != 0) {
    out +=
        "#extension GL_KHR_shader_subgroup_basic : require\n"
        "#extension GL_KHR_shader_subgroup_arithmetic : require\n";
  }
  if (shape.shuffles) out += "#extension GL_KHR_shader_subgroup_shuffle : require\n";
  const auto define = [&out](std::string_view name, std::uint32_t value) {
    out += fmt::format("#define {} {}\n", name, value);
  };
  out += fmt::format("#define KERNEL_{}\n#define WORKGROUP {}\n", found.line->name, shape.workgroup);
  if (shape.subgroups != 0) out += fmt::format("#define SUBGROUPS {}\n", shape.subgroups);
  if (shape.texel) out += "#define TEXEL\n";
  if (shape.shuffles) out += "#define SHUFFLES\n";
  for (const auto& [macro, value] : found.macros) define(macro, static_cast<std::uint32_t>(value));
  if (found.macros.contains("COLUMNS")) define("CHUNK", chunks_of(found, shape).columns);
  return out;
}

Program::Program(const FoundKernel& found, const Context& context, std::span<const std::byte> binary) {
  const KernelLine& line = *found.line;
  using Stage = vk::ShaderStageFlagBits;
  std::vector<vk::DescriptorSetLayoutBinding> bindings;
  for (std::uint32_t i = 0; i < line.access.size(); ++i) {
    texels.push_back(context.adapter.shape.texel ? texels_of(line.name, i) : vk::Format::eUndefined);
    types.push_back(texels.back() != vk::Format::eUndefined ? vk::DescriptorType::eStorageTexelBuffer
                                                            : vk::DescriptorType::eStorageBuffer);
    bindings.emplace_back(i, types.back(), 1, Stage::eCompute);
  }
  chunks = chunks_of(found, context.adapter.shape).count;
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
