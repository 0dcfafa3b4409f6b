#include "interflect/scene/convex.h"

#include <algorithm>
#include <cmath>

namespace interflect {

namespace {

/// The signed distance of points from a side of an outline, positive inside.
struct Side {
  Vec3 start, inward;
  Side(Vec3 a, Vec3 b, Vec3 normal) : start(a), inward(normalized(cross(normal, b - a))) {}
  [[nodiscard]] double operator()(Vec3 p) const { return dot(inward, p - start); }
};

/// The part of a convex outline with sign · side >= 0.
Outline clipped(const Outline& piece, const Side& side, double sign, double slack) {
  Outline out;
  const std::size_t n = piece.size();
  const auto at = [&](std::size_t i) {
    const double d = sign * side(piece[i % n]);
    return std::abs(d) <= slack ? 0 : d;
  };
  for (std::size_t i = 0; i < n; ++i) {
    const double here = at(i), next = at(i + 1);
    if (here >= 0) out.push_back(piece[i]);
    if (here * next < 0) out.push_back(piece[i] + (piece[(i + 1) % n] - piece[i]) * (here / (here - next)));
  }
  return out;
}

/// Whether an outline is thicker than the slack anywhere.
bool has_area(const Outline& piece, double slack) {
  if (piece.size() < 3) return false;
  double around = 0;
  for (std::size_t i = 0; i < piece.size(); ++i) around += length(piece[(i + 1) % piece.size()] - piece[i]);
  return length(area_vector(piece)) > 0.5 * slack * around;
}

}  // namespace

Vec3 area_vector(std::span<const Vec3> outline) {
  Vec3 sum{};
  for (std::size_t i = 1; i + 1 < outline.size(); ++i) {
    sum += 0.5 * cross(outline[i] - outline[0], outline[i + 1] - outline[0]);
  }
  return sum;
}

Vec3 middle(std::span<const Vec3> outline) {
  Vec3 sum{};
  for (const Vec3 p : outline) sum += p;
  return outline.empty() ? sum : sum / static_cast<double>(outline.size());
}

double distance_from_plane(std::span<const Vec3> outline, Vec3 point, Vec3 normal) {
  double most = 0;
  for (const Vec3 p : outline) most = std::max(most, std::abs(dot(normal, p - point)));
  return most;
}

bool is_convex(std::span<const Vec3> outline, Vec3 normal) {
  const std::size_t n = outline.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3 in = outline[(i + 1) % n] - outline[i], on = outline[(i + 2) % n] - outline[(i + 1) % n];
    if (dot(normal, cross(in, on)) < -1e-9 * length(in) * length(on)) return false;
  }
  return true;
}

bool encloses(std::span<const Vec3> outline, Vec3 normal, std::span<const Vec3> inner, double slack) {
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Side side(outline[i], outline[(i + 1) % outline.size()], normal);
    if (std::any_of(inner.begin(), inner.end(), [&](Vec3 p) { return side(p) < -slack; })) return false;
  }
  return true;
}

void subtract(const Outline& piece, std::span<const Vec3> hole, Vec3 normal, double slack, std::vector<Outline>& out) {
  std::vector<Outline> outside;
  Outline rest = piece;
  for (std::size_t i = 0; i < hole.size(); ++i) {
    const Side side(hole[i], hole[(i + 1) % hole.size()], normal);
    Outline beyond = clipped(rest, side, -1, slack);
    rest = clipped(rest, side, 1, slack);
    if (!has_area(rest, slack)) {
      out.push_back(piece);
      return;
    }
    if (has_area(beyond, slack)) outside.push_back(std::move(beyond));
  }
  out.insert(out.end(), outside.begin(), outside.end());
}

}  // namespace interflect
