#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// A flat piece of one surface's side, laid out in its plane without overlap.
struct Chart {
  std::vector<std::uint32_t> patches;
  Vec3 origin{};                 ///< the point of the plane that lies at (0, 0)
  Vec3 across{}, down{};         ///< unit vectors of the plane; from the front, `down` is `across` turned clockwise
  double width = 0, height = 0;  ///< the rectangle that holds the chart, in the scene's unit; width >= height

  /// Where a point of the chart lies: (0, 0) to (width, height).
  [[nodiscard]] Vec2 place(Vec3 point) const { return {dot(point - origin, across), dot(point - origin, down)}; }
};

/// The mesh as charts; each patch is in one of them.
struct Charts {
  std::vector<Chart> list;
  std::vector<std::uint32_t> of_patch;  ///< per patch: index into list
};

/// Joins the triangles of the model that belong to one surface, show the same side, share whole edges and lie nearly in
/// one plane (normals within 0.02 radians of the first one's, corners within 0.005 of the scene's diagonal of its
/// plane), on which they are projected: no length changes by more than 2e-4. All patches of one side of a model's
/// triangle are in the same chart. Triangles that overlap in their plane go to different charts. Each chart is turned
/// so that its rectangle is the smallest. Deterministic.
[[nodiscard]] Charts flat_charts(const PatchMesh& mesh);

using Triangle2 = std::array<Vec2, 3>;

/// Whether two triangles share more than their rims: their overlap is deeper than `slack` in every direction.
[[nodiscard]] bool overlap(const Triangle2& a, const Triangle2& b, double slack);

/// A layer for each triangle so that no two triangles of one layer overlap: 0 for all where none do.
[[nodiscard]] std::vector<std::uint32_t> layers_without_overlap(const std::vector<Triangle2>& triangles, double slack);

}  // namespace interflect
