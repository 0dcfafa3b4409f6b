#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace interflect::vulkan {

/// glslang's version, for the key of a compiled kernel.
[[nodiscard]] std::string glslang_version();

/// A compute shader as SPIR-V 1.3 for Vulkan 1.1. Throws a plain std::string for a source that does not compile: one
/// line "FILE:LINE: CAUSE" of the first error, then the compiler's whole log.
[[nodiscard]] std::vector<std::byte> compile_glsl(const std::string& source);

}  // namespace interflect::vulkan
