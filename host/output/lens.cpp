#include "interflect/output/lens.h"

#include <cmath>
#include <numbers>

#include "interflect/base/error.h"

namespace interflect {

Lens::Lens(const Camera& camera, double aspect)
    : eye_(camera.eye),
      forward_(normalized(camera.target - camera.eye)),
      width_(aspect * std::tan(camera.vertical_fov / 2)),
      height_(std::tan(camera.vertical_fov / 2)) {
  if (!finite(camera.eye) || !finite(camera.target) || !finite(camera.up)) {
    throw Error(ErrorKind::usage, "camera: a coordinate is not a finite number");
  }
  if (length(forward_) < 0.5) throw Error(ErrorKind::usage, "camera: eye and target are the same point");
  if (!(camera.vertical_fov > 0 && camera.vertical_fov < std::numbers::pi)) {
    throw Error(ErrorKind::usage, "camera: the field of view must lie between 0 and 180 degrees");
  }
  if (!(aspect > 0) || !std::isfinite(aspect)) {
    throw Error(ErrorKind::usage, "camera: the picture's width over height must be a positive number");
  }
  right_ = cross(forward_, normalized(camera.up));
  if (length(right_) < 1e-6) right_ = cross(forward_, std::abs(forward_.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{0, 1, 0});
  right_ = normalized(right_);
  up_ = cross(right_, forward_);
}

}  // namespace interflect
