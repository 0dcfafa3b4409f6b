#pragma once

#include <string>
#include <string_view>

#include "interflect/scene/scene.h"

namespace interflect {

/// True when the bytes start like a PNG file.
[[nodiscard]] bool is_png(std::string_view bytes);

/// Decodes a PNG to linear RGB (sRGB is decoded, alpha dropped). `file` names it in messages. Throws an input Error for
/// damaged data, and before it allocates anything for a size that so few bytes cannot hold or above 2^26 pixels.
[[nodiscard]] Image decode_png(std::string_view bytes, const std::string& file);

}  // namespace interflect
