#include "interflect/device/vulkan/glsl.h"

#include <fmt/format.h>
#include <glslang/Public/ResourceLimits.h>
#include <glslang/Public/ShaderLang.h>
#include <glslang/SPIRV/GlslangToSpv.h>

#include <cstring>
#include <string_view>

namespace interflect::vulkan {

namespace {

/// "FILE:LINE: CAUSE" of the log's first error, then the log.
[[noreturn]] void throw_log(std::string_view log) {
  constexpr std::string_view mark = "ERROR: ";
  const std::size_t found = log.find(mark);
  const std::string_view from = found == std::string_view::npos ? log : log.substr(found + mark.size());
  throw fmt::format("{}\n{}", from.substr(0, from.find('\n')), log);
}

/// Of the whole process; the threads that compile share it.
void initialise_glslang() {
  static const bool done = glslang::InitializeProcess();
  if (!done) throw std::string("glslang cannot be initialised");
}

}  // namespace

std::string glslang_version() {
  const glslang::Version version = glslang::GetVersion();
  return fmt::format("glslang {}.{}.{}", version.major, version.minor, version.patch);
}

std::vector<std::byte> compile_glsl(const std::string& source) {
  initialise_glslang();
  constexpr EShLanguage stage = EShLangCompute;
  constexpr auto rules = static_cast<EShMessages>(EShMsgSpvRules | EShMsgVulkanRules);
  const char* text = source.c_str();
  glslang::TShader shader(stage);
  shader.setStrings(&text, 1);
  shader.setEnvInput(glslang::EShSourceGlsl, stage, glslang::EShClientVulkan, 110);
  shader.setEnvClient(glslang::EShClientVulkan, glslang::EShTargetVulkan_1_1);
  shader.setEnvTarget(glslang::EShTargetSpv, glslang::EShTargetSpv_1_3);
  if (!shader.parse(GetDefaultResources(), 450, false, rules)) throw_log(shader.getInfoLog());
  glslang::TProgram program;
  program.addShader(&shader);
  if (!program.link(rules)) throw_log(program.getInfoLog());

  std::vector<unsigned int> words;
  glslang::SpvOptions options;
  options.disableOptimizer = true;
  glslang::GlslangToSpv(*program.getIntermediate(stage), words, &options);
  std::vector<std::byte> bytes(words.size() * sizeof words[0]);
  std::memcpy(bytes.data(), words.data(), bytes.size());
  return bytes;
}

}  // namespace interflect::vulkan
