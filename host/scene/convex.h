#pragma once

#include <span>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect {

/// A flat outline, counter-clockwise about its normal.
using Outline = std::vector<Vec3>;

/// ½ Σ p_i × p_i+1: along the normal, as long as the area. Zero for an outline that encloses none.
[[nodiscard]] Vec3 area_vector(std::span<const Vec3> outline);

/// The mean of the corners.
[[nodiscard]] Vec3 middle(std::span<const Vec3> outline);

/// The largest distance of a corner from the plane through `point`. `normal` is a unit vector.
[[nodiscard]] double distance_from_plane(std::span<const Vec3> outline, Vec3 point, Vec3 normal);

/// Whether no corner turns right, seen against the unit `normal`, by more than rounding.
[[nodiscard]] bool is_convex(std::span<const Vec3> outline, Vec3 normal);

/// Whether no corner of `inner` lies further than `slack` outside the convex outline.
[[nodiscard]] bool encloses(std::span<const Vec3> outline, Vec3 normal, std::span<const Vec3> inner, double slack);

/// Adds what of the convex `piece` lies outside the convex `hole` in its plane, as convex pieces: at most one for each
/// side of the hole, and `piece` itself where they do not overlap. What lies within `slack` of a side counts as on it.
void subtract(const Outline& piece, std::span<const Vec3> hole, Vec3 normal, double slack, std::vector<Outline>& out);

}  // namespace interflect
