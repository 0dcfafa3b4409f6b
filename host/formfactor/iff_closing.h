#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "interflect/formfactor/iff_file.h"

namespace interflect::iff {

/// The closing section's body.
[[nodiscard]] std::string encode(const IffClosing& closing);
/// The same read back, of n patches. Throws an input Error naming the file when the bytes are not one: lengths beyond
/// the end, indices out of range, areas or scalings that are not positive numbers.
[[nodiscard]] IffClosing decode(std::span<const std::byte> body, std::uint32_t n, std::string_view file);

}  // namespace interflect::iff
