#include "interflect/formfactor/hemisphere.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "interflect/formfactor/sampling.h"

namespace interflect {

namespace {

constexpr double lift_of_extent = 2e-6;  // as the shadow rays

struct Frame {
  Vec3 u, v, n;
};
Frame frame(Vec3 n) {
  const Vec3 other = std::abs(n.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 u = normalized(cross(other, n));
  return {u, cross(n, u), n};
}

/// Malley's method: uniform on the disc, lifted to the hemisphere.
Vec3 cosine_direction(const Frame& f, sampling::Square s) {
  constexpr double unit = 1.0 / 4294967296.0;
  const double r2 = (s.u + 0.5) * unit, phi = 2 * std::numbers::pi * s.v * unit, r = std::sqrt(r2);
  return r * std::cos(phi) * f.u + r * std::sin(phi) * f.v + std::sqrt(1 - r2) * f.n;
}

}  // namespace

std::uint32_t hemisphere_rays(std::size_t patches) {
  return static_cast<std::uint32_t>(
      std::clamp<std::size_t>((std::size_t{1} << 17) / std::max<std::size_t>(patches, 1), 32, 1024));
}

double HemisphereShares::mean(const PatchTable& patches, const std::vector<float>& share,
                              const std::vector<bool>& counts) {
  double sum = 0, area = 0;
  for (std::size_t i = 0; i < patches.size; ++i) {
    if (!counts[i]) continue;
    sum += patches.area[i] * static_cast<double>(share[i]);
    area += patches.area[i];
  }
  return area > 0 ? sum / area : 0;
}

HemisphereShares look_around(const PatchTable& patches, const Visibility& visibility,
                             const std::vector<bool>& two_sided, std::uint64_t seed) {
  HemisphereShares out{std::vector<float>(patches.size), std::vector<float>(patches.size)};
  const std::uint32_t rays = hemisphere_rays(patches.size);
  const double lift = lift_of_extent * patches.extent;
#pragma omp parallel for schedule(dynamic, 64)
  for (std::size_t i = 0; i < patches.size; ++i) {
    const auto corners = patches.triangle(i);
    const Frame axes = frame(patches.front(i));
    const std::uint64_t h = sampling::hash(seed + 0x68656d69, i);
    const std::uint64_t g = sampling::hash(h, i);
    const Vec3 ab = corners[1] - corners[0], ac = corners[2] - corners[0];
    std::uint32_t escaped = 0, backs = 0;
    for (std::uint32_t k = 0; k < rays; ++k) {
      const auto& step = sampling::step4;
      const auto [u, v] = sampling::in_triangle(sampling::unit(static_cast<std::uint32_t>(h) + k * step[0]),
                                                sampling::unit(static_cast<std::uint32_t>(h >> 32) + k * step[1]));
      const Vec3 start = corners[0] + static_cast<double>(u) * ab + static_cast<double>(v) * ac + lift * axes.n;
      const Vec3 d = cosine_direction(
          axes, {static_cast<std::uint32_t>(g) + k * step[2], static_cast<std::uint32_t>(g >> 32) + k * step[3]});
      const auto hit =
          visibility.closest({{static_cast<float>(start.x), static_cast<float>(start.y), static_cast<float>(start.z)},
                              0,
                              {static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)},
                              std::numeric_limits<float>::infinity()});
      if (!hit) {
        ++escaped;
      } else if (!hit->front && !two_sided[hit->triangle]) {
        ++backs;
      }
    }
    out.escape[i] = static_cast<float>(escaped) / static_cast<float>(rays);
    out.back[i] = static_cast<float>(backs) / static_cast<float>(rays);
  }
  return out;
}

}  // namespace interflect
