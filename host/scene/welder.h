#pragma once

#include <array>
#include <cstdint>
#include <map>

#include "interflect/scene/primitives.h"

namespace interflect {

/// Builds a mesh from triangles given by their corners: equal corners become one vertex, collapsed triangles are left
/// out. For meshes of bounded size.
class Welder {
 public:
  void triangle(Vec3 a, Vec3 b, Vec3 c) {
    const std::array<std::uint32_t, 3> corner{vertex(a), vertex(b), vertex(c)};
    if (corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0]) mesh_.triangles.push_back(corner);
  }
  /// a b c and a c d.
  void quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }
  [[nodiscard]] SurfaceMesh take() { return std::move(mesh_); }

 private:
  std::uint32_t vertex(Vec3 p) {
    p += Vec3{0, 0, 0};  // -0 becomes 0
    const auto next = static_cast<std::uint32_t>(mesh_.positions.size());
    const auto [entry, added] = index_.try_emplace({p.x, p.y, p.z}, next);
    if (added) mesh_.positions.push_back(p);
    return entry->second;
  }

  SurfaceMesh mesh_;
  std::map<std::array<double, 3>, std::uint32_t> index_;
};

}  // namespace interflect
