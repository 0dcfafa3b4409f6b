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

}  // namespace

Sight::Sight(const PatchMesh& mesh) : mesh_(mesh), visibility_(mesh.vertices, mesh.corners), twin_(find_twins(mesh)) {
  bool first = true;
  for (const auto& corners : mesh.corners) {
    for (const std::uint32_t v : corners) {
      const Vec3 p = mesh.vertices[v];
      low_ = first ? p : min(low_, p);
      high_ = first ? p : max(high_, p);
      first = false;
    }
  }
}

std::optional<Sight::Seen> Sight::next(Vec3 eye, Vec3 direction, float near) const {
  Visibility::Ray ray;
  for (int axis = 0; axis < 3; ++axis) {
    ray.origin[static_cast<std::size_t>(axis)] = static_cast<float>(eye[axis]);
    ray.direction[static_cast<std::size_t>(axis)] = static_cast<float>(direction[axis]);
  }
  ray.near = near;
  ray.far = std::numeric_limits<float>::infinity();
  const auto hit = visibility_.closest(ray);
  if (!hit) return std::nullopt;
  Seen seen{hit->triangle, static_cast<double>(hit->t), hit->u, hit->v, hit->front};
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
    const double step = std::max(1e-5 * seen->distance, 1e-6 * extent() / length(direction));
    seen = next(eye, direction, static_cast<float>(seen->distance + step));
  }
  return seen && seen->front ? seen : std::nullopt;
}

}  // namespace interflect
