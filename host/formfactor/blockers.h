#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/formfactor/kernel.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/visibility.h"

namespace interflect {

struct Box {
  Vec3 low, high;
};

/// Where the rays between two boxes run: the hull of the boxes (Haines and Wallace 1991), less what lies behind a plane
/// that all rays start or end in front of.
struct Shaft {
  Box around;                          ///< the boxes' common box
  std::array<kernel::Plane, 12> side;  ///< the hull's oblique sides, fronts outward
  std::size_t sides = 0;
  double slack = 0;                     ///< what is nearer than this to the shaft counts as in it
  std::vector<kernel::Plane> from, to;  ///< of the patches in either box that send or receive rays
  double behind = 0;                    ///< what is nearer than this to such a plane counts as on it

  /// The hull of the two boxes alone.
  Shaft(const Box& a, const Box& b, double slack);
};

/// What can hide one patch from another. The two sides of a two-sided patch are one triangle here, and so are the
/// patches that tile one source triangle: fewer triangles, and no cracks where patches of different sizes meet in it.
class Blockers {
 public:
  /// Of all patches of a mesh, in the coordinates of its table.
  Blockers(const PatchMesh& mesh, const PatchTable& patches);
  /// Of triangles given as indices into vertices, all one-sided.
  Blockers(std::vector<Vec3> vertices, std::vector<std::array<std::uint32_t, 3>> triangles);

  [[nodiscard]] const Visibility& visibility() const { return visibility_; }
  /// What visibility() traces, for other hierarchies over the same.
  [[nodiscard]] const std::vector<Vec3>& vertices() const { return shape_.vertices; }
  [[nodiscard]] const std::vector<std::array<std::uint32_t, 3>>& triangles() const { return shape_.triangles; }
  /// Per triangle of visibility(): whether there is a patch on each side.
  [[nodiscard]] const std::vector<bool>& two_sided() const { return shape_.two_sided; }

  /// False: nothing lies in the shaft, every ray in it is free. `hint` is a number of the caller's, 0 at first, that
  /// makes the next question faster where one blocker stands in many shafts.
  [[nodiscard]] bool any_in(const Shaft& shaft, std::size_t& hint) const;

 private:
  struct Shape {
    std::vector<Vec3> vertices;
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<bool> two_sided;  ///< per triangle
  };
  static Shape shape(const PatchMesh& mesh, const PatchTable& patches);
  explicit Blockers(Shape shape);
  [[nodiscard]] bool cluster_in(const Shaft& shaft, std::size_t cluster) const;

  Shape shape_;
  Visibility visibility_;
  std::vector<Box> clusters_;  ///< of triangles with consecutive numbers
};

}  // namespace interflect
