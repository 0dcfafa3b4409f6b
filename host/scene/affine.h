#pragma once

#include <cmath>
#include <numbers>
#include <utility>

#include "interflect/base/vec3.h"

namespace interflect {

/// Cosine and sine of an angle in degrees, exact at multiples of 90°.
inline std::pair<double, double> cos_sin_degrees(double degrees) {
  const double turn = std::remainder(degrees, 360.0);  // in [-180, 180]
  if (turn == 0) return {1, 0};
  if (turn == 90) return {0, 1};
  if (turn == -90) return {0, -1};
  if (std::abs(turn) == 180) return {-1, 0};
  const double radians = turn * (std::numbers::pi / 180);
  return {std::cos(radians), std::sin(radians)};
}

/// An affine map p -> x p.x + y p.y + z p.z + origin: x, y, z are the images of the axes.
struct Affine {
  Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, origin{};

  [[nodiscard]] constexpr Vec3 direction(Vec3 d) const { return x * d.x + y * d.y + z * d.z; }
  [[nodiscard]] constexpr Vec3 point(Vec3 p) const { return direction(p) + origin; }
  /// Below zero the map mirrors: what ran counter-clockwise runs clockwise afterwards.
  [[nodiscard]] constexpr double determinant() const { return dot(x, cross(y, z)); }
};

/// First `inner`, then `outer`.
constexpr Affine operator*(const Affine& outer, const Affine& inner) {
  return {outer.direction(inner.x), outer.direction(inner.y), outer.direction(inner.z), outer.point(inner.origin)};
}

constexpr Affine translation(Vec3 by) {
  return {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, by};
}
constexpr Affine scaling(Vec3 by) {
  return {{by.x, 0, 0}, {0, by.y, 0}, {0, 0, by.z}, {}};
}

inline bool finite(const Affine& a) {
  return finite(a.x) && finite(a.y) && finite(a.z) && finite(a.origin);
}

}  // namespace interflect
