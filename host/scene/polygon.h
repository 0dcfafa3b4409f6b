#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect {

struct Triangulation {
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< n - 2 of them, indices into the corners, winding kept
  bool simple = true;  ///< false: the outline crosses itself or has no area, so that the triangles may overlap
};

/// The largest outline that is not seen whole from its first corner. Clipping ears takes time of the order n².
inline constexpr std::size_t most_concave_corners = 4096;

/// Cuts a flat polygon into triangles: a fan where the first corner sees all others, ear clipping otherwise (in the
/// plane of the polygon's area vector, Σ p_i × p_i+1). Throws an input Error without a place for a concave one of more
/// than most_concave_corners.
[[nodiscard]] Triangulation triangulate(std::span<const Vec3> corners);

}  // namespace interflect
