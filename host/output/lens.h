#pragma once

#include "interflect/scene/scene.h"

namespace interflect {

/// A camera with its picture plane laid out: directions through points of the picture.
class Lens {
 public:
  /// Throws a usage Error when eye and target coincide, a number is not finite, or the field of view is not between 0
  /// and π. An up that is parallel to the view is replaced by an axis that is not.
  Lens(const Camera& camera, double aspect);

  /// The direction through (x, y): 0..1 from left to right and from top to bottom. Its length along the view is 1.
  [[nodiscard]] Vec3 direction(double x, double y) const {
    return forward_ + right_ * ((2 * x - 1) * width_) + up_ * ((1 - 2 * y) * height_);
  }
  [[nodiscard]] Vec3 eye() const { return eye_; }
  [[nodiscard]] Vec3 forward() const { return forward_; }
  [[nodiscard]] Vec3 right() const { return right_; }
  [[nodiscard]] Vec3 up() const { return up_; }
  /// tan of half the field of view, across and upwards.
  [[nodiscard]] double half_width() const { return width_; }
  [[nodiscard]] double half_height() const { return height_; }

 private:
  Vec3 eye_, forward_, right_, up_;
  double width_, height_;
};

}  // namespace interflect
