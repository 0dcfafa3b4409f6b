#include "interflect/output/sight.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace interflect {

namespace {

std::array<std::uint32_t, 3> sorted(std::array<std::uint32_t, 3> corners) {
  std::sort(corners.begin(), corners.end());
  return corners;
}

std::vector<std::uint32_t> find_twins(const PatchMesh& mesh) {
  std::vector<std::uint32_t> twin(mesh.size()), order(mesh.size());
  std::iota(twin.begin(), twin.end(), 0U);
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t i, std::uint32_t j) {
    return std::pair(sorted(mesh.corners[i]), i) < std::pair(sorted(mesh.corners[j]), j);
  });
  for (std::size_t k = 0; k + 1 < order.size(); ++k) {
    const std::uint32_t i = order[k], j = order[k + 1];
    if (sorted(mesh.corners[i]) != sorted(mesh.corners[j]) || dot(mesh.normal[i], mesh.normal[j]) > 0) continue;
    twin[i] = j, twin[j] = i;
  }
  return twin;
}

std::vector<Vec3> moved(const std::vector<Vec3>& points, Vec3 centre, double scale) {
  std::vector<Vec3> out;
  out.reserve(points.size());
  for (const Vec3 p : points) out.push_back((p - centre) * scale);
  return out;
}

}  // namespace

Sight::Box::Box(const PatchMesh& mesh) {
  bool first = true;
  for (const auto& corners : mesh.corners) {
    for (const std::uint32_t v : corners) {
      const Vec3 p = mesh.vertices[v];
      low = first ? p : min(low, p);
      high = first ? p : max(high, p);
      first = false;
    }
  }
  centre = (low + high) / 2;
  scale = extent() > 0 ? 1 / extent() : 1;
}

Sight::Sight(const PatchMesh& mesh)
    : mesh_(mesh),
      box_(mesh),
      visibility_(moved(mesh.vertices, box_.centre, box_.scale), mesh.corners),
      twin_(find_twins(mesh)) {}

Sight::Aim Sight::aim(Vec3 eye, Vec3 direction, double near) const {
  // In lengths of the scene's diagonal, from its middle: Embree's floats would drown a scene far from the origin, and
  // Embree takes no rays from beyond 1e18. Nothing lies farther than 0.5 from the middle, so the ray starts about 1
  // before the point where it passes nearest.
  constexpr double far_away = 4;
  Aim a;
  a.unit = length(direction) * box_.scale;
  const Vec3 along = normalized(direction);
  Vec3 origin = (eye - box_.centre) * box_.scale;
  a.skipped = std::max(0.0, -dot(origin, along) - 1);
  origin = origin + along * a.skipped;
  a.lost = !(length(origin) < far_away);
  for (int axis = 0; axis < 3; ++axis) {
    a.ray.origin[static_cast<std::size_t>(axis)] = static_cast<float>(origin[axis]);
    a.ray.direction[static_cast<std::size_t>(axis)] = static_cast<float>(along[axis]);
  }
  a.ray.near = static_cast<float>(std::clamp(near * a.unit - a.skipped, 0.0, 2 * far_away));
  a.ray.far = std::numeric_limits<float>::infinity();
  return a;
}

Sight::Seen Sight::seen_of(const Visibility::Hit& hit, const Aim& aim) const {
  const Seen seen{hit.triangle, (static_cast<double>(hit.t) + aim.skipped) / aim.unit, hit.u, hit.v, hit.front};
  const std::uint32_t other = twin_[hit.triangle];
  if (seen.front || other == hit.triangle) return seen;
  const std::array<float, 3> share{1 - hit.u - hit.v, hit.u, hit.v};
  const auto& from = mesh_.corners[hit.triangle];
  const auto& to = mesh_.corners[other];
  const auto share_at = [&](std::size_t k) {
    return share[static_cast<std::size_t>(std::find(from.begin(), from.end(), to[k]) - from.begin())];
  };
  return Seen{other, seen.distance, share_at(1), share_at(2), true};
}

std::optional<Sight::Seen> Sight::next(Vec3 eye, Vec3 direction, double near) const {
  const Aim a = aim(eye, direction, near);
  if (a.lost) return std::nullopt;
  const auto hit = visibility_.closest(a.ray);
  return hit ? std::optional(seen_of(*hit, a)) : std::nullopt;
}

void Sight::fronts(Vec3 eye, std::span<const Vec3> directions, std::span<Seen> seen) const {
  constexpr std::size_t at_once = 256;
  std::array<Aim, at_once> aims;              // NOLINT: filled below
  std::array<Visibility::Ray, at_once> rays;  // NOLINT
  std::array<Visibility::Hit, at_once> hits;
  for (std::size_t first = 0; first < directions.size(); first += at_once) {
    const std::size_t count = std::min(at_once, directions.size() - first);
    for (std::size_t k = 0; k < count; ++k) {
      aims[k] = aim(eye, directions[first + k], 0);
      rays[k] = aims[k].ray;
      if (aims[k].lost) rays[k] = {{}, 0, {1, 0, 0}, -1};  // meets nothing
    }
    visibility_.closest(std::span(rays).first(count), std::span(hits).first(count));
    for (std::size_t k = 0; k < count; ++k) {
      Seen& out = seen[first + k];
      out = {};
      if (aims[k].lost || hits[k].triangle == Visibility::nothing) continue;
      out = seen_of(hits[k], aims[k]);
      if (!out.front) out = front(eye, directions[first + k]).value_or(Seen{});
    }
  }
}

std::optional<Sight::Seen> Sight::front(Vec3 eye, Vec3 direction) const {
  constexpr int layers = 256;  // more backs in a row than this are taken for nothing, so that no ray runs forever
  auto seen = next(eye, direction, 0);
  for (int layer = 0; layer < layers && seen && !seen->front; ++layer) {
    const double unit = extent() / length(direction);
    const double step = std::max(1e-5 * std::min(seen->distance, unit), 1e-6 * unit);
    seen = next(eye, direction, seen->distance + step);
  }
  return seen && seen->front ? seen : std::nullopt;
}

}  // namespace interflect
