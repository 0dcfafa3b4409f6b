#include "interflect/scene/polygon.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "interflect/base/error.h"

namespace interflect {

namespace {

/// The polygon seen along the axis nearest to its area vector, from the side where it runs counter-clockwise.
std::vector<Vec2> projected(std::span<const Vec3> corners) {
  const Vec3 origin = corners[0];
  Vec3 area{};
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    area += cross(corners[i] - origin, corners[i + 1] - origin);
  }
  const Vec3 size{std::abs(area.x), std::abs(area.y), std::abs(area.z)};
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const double sign = area[axis] < 0 ? -1 : 1;
  std::vector<Vec2> out;
  out.reserve(corners.size());
  for (const Vec3 p : corners) out.push_back({p[u] - origin[u], sign * (p[v] - origin[v])});
  return out;
}

/// Twice the signed area of abc.
double turn(Vec2 a, Vec2 b, Vec2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// Whether the way a b c turns left by more than rounding.
bool turns_left(Vec2 a, Vec2 b, Vec2 c) {
  return turn(a, b, c) > 1e-11 * std::hypot(b.x - a.x, b.y - a.y) * std::hypot(c.x - b.x, c.y - b.y);
}

class EarClipper {
 public:
  explicit EarClipper(std::vector<Vec2> points) : points_(std::move(points)), ring_(points_.size()) {
    double extent = 0;
    for (const Vec2 p : points_) extent = std::max({extent, std::abs(p.x), std::abs(p.y)});
    rounding_ = 1e-15 * extent * extent;
    for (std::uint32_t i = 0; i < points_.size(); ++i) ring_[i] = i;
  }

  [[nodiscard]] bool fan() const {
    for (std::size_t i = 1; i + 1 < points_.size(); ++i) {
      if (!turns_left(points_[0], points_[i], points_[i + 1])) return false;
      if (turn(points_[0], points_[1], points_[i + 1]) < 0) return false;  // beyond half a turn
    }
    return true;
  }

  Triangulation clip();

 private:
  /// How careful to be. Outlines that cross themselves have no proper ears left at some point.
  enum class Care { strict, loose, none };

  [[nodiscard]] Vec2 at(std::size_t position) const { return points_[ring_[position % ring_.size()]]; }
  [[nodiscard]] bool is_ear(std::size_t position) const;
  void test_all();

  std::vector<Vec2> points_;
  std::vector<std::uint32_t> ring_;  ///< the corners that are left
  std::vector<char> ear_;            ///< whether each of them can be cut off
  double rounding_ = 0;              ///< of turn()
  Care care_ = Care::strict;
};

bool EarClipper::is_ear(std::size_t position) const {
  if (care_ == Care::none) return true;
  const std::size_t n = ring_.size();
  const Vec2 a = at(position + n - 1), b = at(position), c = at(position + 1);
  if (!turns_left(a, b, c)) return false;
  const double inside = care_ == Care::strict ? -rounding_ : rounding_;
  for (std::size_t k = 2; k + 1 < n; ++k) {
    const Vec2 p = at(position + k);
    if (p == a || p == b || p == c) continue;
    if (turn(a, b, p) > inside && turn(b, c, p) > inside && turn(c, a, p) > inside) return false;
  }
  return true;
}

void EarClipper::test_all() {
  ear_.resize(ring_.size());
  for (std::size_t i = 0; i < ring_.size(); ++i) ear_[i] = is_ear(i);
}

Triangulation EarClipper::clip() {
  Triangulation out;
  test_all();
  int repeats = 0;
  std::size_t from = 0;
  while (ring_.size() > 3) {
    const std::size_t n = ring_.size();
    std::size_t position = from % n;
    std::size_t passed = 0;
    for (; passed < n && !ear_[position]; ++passed) position = (position + 1) % n;
    if (passed == n) {
      // Cutting an ear can free another corner than its neighbours when the outline touches itself: look again before
      // giving up care, but not often, since that costs n².
      test_all();
      if (std::find(ear_.begin(), ear_.end(), 1) != ear_.end() && ++repeats <= 8) continue;
      care_ = care_ == Care::strict && repeats <= 8 ? Care::loose : Care::none;
      out.simple = out.simple && care_ != Care::none;
      test_all();
      continue;
    }
    out.triangles.push_back({ring_[(position + n - 1) % n], ring_[position], ring_[(position + 1) % n]});
    ring_.erase(ring_.begin() + static_cast<std::ptrdiff_t>(position));
    ear_.erase(ear_.begin() + static_cast<std::ptrdiff_t>(position));
    const std::size_t before = (position + n - 2) % (n - 1), after = position % (n - 1);
    ear_[before] = is_ear(before);
    ear_[after] = is_ear(after);
    from = after + 1;  // not the same corner again: that would make a fan of thin triangles
  }
  out.triangles.push_back({ring_[0], ring_[1], ring_[2]});
  return out;
}

}  // namespace

Triangulation triangulate(std::span<const Vec3> corners) {
  if (corners.size() == 3) return {{{0, 1, 2}}, true};
  EarClipper clipper(projected(corners));
  if (clipper.fan()) {
    Triangulation out;
    for (std::uint32_t i = 1; i + 1 < corners.size(); ++i) out.triangles.push_back({0, i, i + 1});
    return out;
  }
  if (corners.size() > most_concave_corners) {
    throw Error(ErrorKind::input, fmt::format("a concave face of {} corners: at most {} are supported", corners.size(),
                                              most_concave_corners));
  }
  return clipper.clip();
}

}  // namespace interflect
