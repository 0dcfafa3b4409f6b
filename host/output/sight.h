#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "interflect/formfactor/visibility.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// What an eye meets along a ray.
class Sight {
 public:
  explicit Sight(const PatchMesh& mesh);

  struct Seen {
    std::uint32_t patch = 0;
    double distance = 0;  ///< in lengths of the direction
    float u = 0, v = 0;   ///< the point is (1 − u − v) a + u b + v c of the patch's corners
    bool front = false;
  };
  /// The first patch of either side. Of the two patches of a two-sided triangle, the one that faces the eye.
  [[nodiscard]] std::optional<Seen> first(Vec3 eye, Vec3 direction) const { return next(eye, direction, 0); }
  /// The first front; backs before it are not there.
  [[nodiscard]] std::optional<Seen> front(Vec3 eye, Vec3 direction) const;

  /// The diagonal of the scene's bounding box, and its corners.
  [[nodiscard]] double extent() const { return length(high_ - low_); }
  [[nodiscard]] Vec3 low() const { return low_; }
  [[nodiscard]] Vec3 high() const { return high_; }

 private:
  [[nodiscard]] std::optional<Seen> next(Vec3 eye, Vec3 direction, float near) const;

  const PatchMesh& mesh_;
  Vec3 low_, high_;
  Visibility visibility_;
  std::vector<std::uint32_t> twin_;  ///< the patch on the other side of the same triangle, or the patch itself
};

}  // namespace interflect
