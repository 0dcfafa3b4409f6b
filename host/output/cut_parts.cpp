#include "interflect/output/cut_parts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

namespace interflect {

namespace {

constexpr std::array<Vec2, 3> corner{{{0, 0}, {1, 0}, {0, 1}}};
constexpr std::uint8_t all_corners = 7;

double turn(Vec2 a, Vec2 b, Vec2 p) {
  return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
}

/// Whether the way from p to q goes through one of the walls.
bool blocked(const std::vector<Cut::Segment>& walls, Vec2 p, Vec2 q) {
  return std::any_of(walls.begin(), walls.end(), [&](const Cut::Segment& s) {
    return turn(s[0], s[1], p) * turn(s[0], s[1], q) < 0 && turn(p, q, s[0]) * turn(p, q, s[1]) <= 0;
  });
}

/// Points spread evenly over the patch (and on no line that a wall is likely to take), and its corners, joined where no
/// wall is between neighbours.
class Parts {
 public:
  Parts(const std::vector<Cut::Segment>& walls, const std::array<bool, 3>& on_wall) : walls_(walls) {
    for (int j = 0; j < steps; ++j) {
      for (int i = 0; i + j < steps; ++i) points_.push_back({(i + 0.31) / steps, (j + 0.37) / steps});
    }
    corners_ = points_.size();
    points_.insert(points_.end(), corner.begin(), corner.end());
    parent_.resize(points_.size());
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
    for (int j = 0; j < steps; ++j) {
      for (int i = 0; i + j < steps; ++i) {
        if (i + 1 + j < steps) join(index(i, j), index(i + 1, j)), join(index(i, j), index(i, j + 1));
        if (i > 0) join(index(i, j), index(i - 1, j + 1));
      }
    }
    constexpr double close = 3.0 / steps;
    for (std::size_t k = 0; k < 3; ++k) {
      if (on_wall[k]) continue;  // it would join both sides
      if (!on_wall[(k + 1) % 3]) join(corners_ + k, corners_ + (k + 1) % 3);
      for (std::size_t p = 0; p < corners_; ++p) {
        if (std::abs(points_[p].x - corner[k].x) + std::abs(points_[p].y - corner[k].y) < close) join(corners_ + k, p);
      }
    }
  }

  [[nodiscard]] bool together(std::size_t k, std::size_t l) { return find(corners_ + k) == find(corners_ + l); }
  /// The share of the points in corner k's part.
  [[nodiscard]] double share(std::size_t k) {
    std::size_t count = 0;
    for (std::size_t p = 0; p < corners_; ++p) count += find(p) == find(corners_ + k) ? 1 : 0;
    return static_cast<double>(count) / static_cast<double>(corners_);
  }

 private:
  static constexpr int steps = 24;
  static constexpr std::size_t index(int i, int j) { return static_cast<std::size_t>(j * steps - j * (j - 1) / 2 + i); }

  void join(std::size_t p, std::size_t q) {
    if (find(p) != find(q) && !blocked(walls_, points_[p], points_[q])) parent_[find(p)] = find(q);
  }
  std::size_t find(std::size_t p) {
    while (parent_[p] != p) p = parent_[p] = parent_[parent_[p]];
    return p;
  }

  const std::vector<Cut::Segment>& walls_;
  std::vector<Vec2> points_;
  std::vector<std::size_t> parent_;
  std::size_t corners_ = 0;
};

/// Distance from a segment to a point, in lengths, where a step (x, y) is x b + y c.
double distance(const Cut::Segment& s, Vec2 p, Vec3 b, Vec3 c) {
  const auto metric = [&](Vec2 from, Vec2 to) { return b * (to.x - from.x) + c * (to.y - from.y); };
  const Vec3 along = metric(s[0], s[1]), to = metric(s[0], p);
  const double square = dot(along, along);
  const double t = square > 0 ? std::clamp(dot(to, along) / square, 0.0, 1.0) : 0;
  return length(to - along * t);
}

/// A little longer at both ends, so that walls that meet leave no gap: feet are found just above the patch, where the
/// patches of a wall that have an edge on it do not quite reach each other.
Cut::Segment longer(const Cut::Segment& s) {
  constexpr double more = 2e-3;
  const Vec2 d{s[1].x - s[0].x, s[1].y - s[0].y};
  const double scale = more / std::max(std::hypot(d.x, d.y), more);
  return {Vec2{s[0].x - scale * d.x, s[0].y - scale * d.y}, Vec2{s[1].x + scale * d.x, s[1].y + scale * d.y}};
}

}  // namespace

std::optional<Cut> cut_of(std::vector<Cut::Segment> walls, Vec3 b, Vec3 c) {
  constexpr double on_corner = 2e-3;  // of √(2 area)
  constexpr double nearly_all = 0.95;
  const double side = std::sqrt(length(cross(b, c)));
  std::array<bool, 3> on_wall{};
  for (std::size_t k = 0; k < 3; ++k) {
    on_wall[k] = std::any_of(walls.begin(), walls.end(),
                             [&](const Cut::Segment& s) { return distance(s, corner[k], b, c) < on_corner * side; });
  }
  std::transform(walls.begin(), walls.end(), walls.begin(), longer);
  Cut cut;
  Parts parts(walls, on_wall);
  for (std::size_t k = 0; k < 3; ++k) {
    if (on_wall[k]) continue;
    cut.share[k] = parts.share(k);
    for (std::size_t l = 0; l < 3; ++l) {
      if (!on_wall[l] && parts.together(k, l)) cut.part[k] = static_cast<std::uint8_t>(cut.part[k] | 1U << l);
    }
  }
  if (cut.part[0] == all_corners && cut.share[0] >= nearly_all) return std::nullopt;
  cut.walls = std::move(walls);
  return cut;
}

std::uint8_t Cut::corners_at(double u, double v) const {
  for (std::size_t k = 0; k < 3; ++k) {
    if (part[k] != 0 && !blocked(walls, {u, v}, corner[k])) return part[k];
  }
  return all_corners;
}

std::array<double, 3> Cut::shares(std::array<double, 3> at) const {
  const std::uint8_t corners = corners_at(at[1], at[2]);
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    at[k] = (corners >> k & 1U) != 0 ? std::max(at[k], 1e-6) : 0;
    sum += at[k];
  }
  for (double& s : at) s /= sum;
  return at;
}

}  // namespace interflect
