#pragma once

#include <cstdint>
#include <optional>
#include <span>
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
  /// The first fronts along many directions from one eye; seen[k].front is false where there is none. Fast where
  /// neighbours in the list are neighbours in the picture.
  void fronts(Vec3 eye, std::span<const Vec3> directions, std::span<Seen> seen) const;

  /// The diagonal of the scene's bounding box, and its corners.
  [[nodiscard]] double extent() const { return box_.extent(); }
  [[nodiscard]] Vec3 low() const { return box_.low; }
  [[nodiscard]] Vec3 high() const { return box_.high; }

 private:
  [[nodiscard]] std::optional<Seen> next(Vec3 eye, Vec3 direction, double near) const;
  /// A ray as the scaled scene needs it.
  struct Aim {
    Visibility::Ray ray;
    double unit = 1;     ///< length of the direction there
    double skipped = 0;  ///< of the way to the scene
    bool lost = false;   ///< it cannot meet anything
  };
  [[nodiscard]] Aim aim(Vec3 eye, Vec3 direction, double near) const;
  [[nodiscard]] Seen seen_of(const Visibility::Hit& hit, const Aim& aim) const;

  struct Box {
    explicit Box(const PatchMesh& mesh);
    [[nodiscard]] double extent() const { return length(high - low); }
    Vec3 low, high, centre;
    double scale = 1;  ///< 1 / extent
  };

  const PatchMesh& mesh_;
  Box box_;
  Visibility visibility_;            ///< of the scene moved by -centre and scaled to an extent of 1
  std::vector<std::uint32_t> twin_;  ///< the patch on the other side of the same triangle, or the patch itself
};

}  // namespace interflect
