#pragma once

#include <array>

#include "interflect/scene/scene.h"

namespace interflect {

/// The mean of the texture over the triangle with these texture coordinates: each texel is a square of one colour, the
/// image repeats. Midpoint rule over n² equal triangles, about two per texel along the longest edge and n <= 64. White
/// for an image without texels.
[[nodiscard]] Rgb mean_over(const Image& image, const std::array<Vec2, 3>& uv);

}  // namespace interflect
