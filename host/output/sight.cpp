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

std::optional<Sight::Seen> Sight::next(Vec3 eye, Vec3 direction, double near) const {
  // In lengths of the scene's diagonal, from its middle: Embree's floats would drown a scene far from the origin, and
  // Embree takes no rays from beyond 1e18. Nothing lies farther than 0.5 from the middle, so the ray starts about 1
  // before the point where it passes nearest.
  constexpr double far_away = 4;
  const double unit = length(direction) * box_.scale;
  const Vec3 along = normalized(direction);
  Vec3 origin = (eye - box_.centre) * box_.scale;
  const double skipped = std::max(0.0, -dot(origin, along) - 1);
  origin = origin + along * skipped;
  if (!(length(origin) < far_away)) return std::nullopt;
  Visibility::Ray ray;
  for (int axis = 0; axis < 3; ++axis) {
    ray.origin[static_cast<std::size_t>(axis)] = static_cast<float>(origin[axis]);
    ray.direction[static_cast<std::size_t>(axis)] = static_cast<float>(along[axis]);
  }
  ray.near = static_cast<float>(std::clamp(near * unit - skipped, 0.0, 2 * far_away));
  ray.far = std::numeric_limits<float>::infinity();
  const auto hit = visibility_.closest(ray);
  if (!hit) return std::nullopt;
  Seen seen{hit->triangle, (static_cast<double>(hit->t) + skipped) / unit, hit->u, hit->v, hit->front};
  const std::uint32_t other = twin_[hit->triangle];
  if (seen.front || other == hit->triangle) return seen;
  const std::array<float, 3> share{1 - hit->u - hit->v, hit->u, hit->v};
  const auto& from = mesh_.corners[hit->triangle];
  const auto& to = mesh_.corners[other];
  const auto share_at = [&](std::size_t k) {
    return share[static_cast<std::size_t>(std::find(from.begin(), from.end(), to[k]) - from.begin())];
  };
  return Seen{other, seen.distance, share_at(1), share_at(2), true};
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
