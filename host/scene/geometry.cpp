#include "interflect/scene/geometry.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

double longest_edge(Vec3 a, Vec3 b, Vec3 c) {
  return std::max({length(b - a), length(c - b), length(a - c)});
}

void require_sound(const Scene& scene, std::size_t index) {
  const Triangle& t = scene.triangles[index];
  const auto fail = [&](const char* cause) {
    throw Error(ErrorKind::usage, fmt::format("the scene's triangle {} {}", index, cause));
  };
  for (const std::uint32_t v : t.vertex) {
    if (v >= scene.positions.size()) fail("names a vertex that does not exist");
    if (!finite(scene.positions[v])) fail("has a corner that is not finite");
  }
  if (t.surface >= scene.surfaces.size()) fail("names a surface that does not exist");
  if (t.uv >= 0 && static_cast<std::uint64_t>(t.uv) + 3 > scene.uvs.size())
    fail("names texture coordinates that do not exist");
  // What a file can hold, since every coordinate for itself is finite.
  if (!std::isfinite(scene.area(t))) throw input_error(scene.file, t.line, "a triangle's area overflows");
}

}  // namespace

void require_sound(const Scene& scene) {
  for (const Surface& surface : scene.surfaces) {
    if (surface.material >= scene.materials.size()) {
      throw Error(ErrorKind::usage, "a surface of the scene names a material that does not exist");
    }
  }
  for (std::size_t i = 0; i < scene.triangles.size(); ++i) require_sound(scene, i);
}

bool degenerate(Vec3 a, Vec3 b, Vec3 c) {
  const double longest = longest_edge(a, b, c);
  const double area = 0.5 * length(cross(b - a, c - a));
  return !(area > 0) || area < 1e-12 * longest * longest;
}

bool degenerate(const Scene& scene, const Triangle& t) {
  return degenerate(scene.positions[t.vertex[0]], scene.positions[t.vertex[1]], scene.positions[t.vertex[2]]);
}

double smallest_altitude(Vec3 a, Vec3 b, Vec3 c) {
  const double longest = longest_edge(a, b, c);
  return longest > 0 ? length(cross(b - a, c - a)) / longest : 0;
}

double diagonal(const Scene& scene) {
  constexpr double inf = std::numeric_limits<double>::infinity();
  Vec3 low{inf, inf, inf}, high{-inf, -inf, -inf};
  for (const Triangle& t : scene.triangles) {
    for (const std::uint32_t v : t.vertex) {
      low = min(low, scene.positions[v]);
      high = max(high, scene.positions[v]);
    }
  }
  return scene.triangles.empty() ? 0 : length(high - low);
}

bool has_two_sides(const Scene& scene, const Triangle& t, bool two_sided) {
  return two_sided || scene.materials[scene.surfaces[t.surface].material].two_sided;
}

double weld_tolerance(double diagonal, std::vector<double> altitudes) {
  if (altitudes.empty()) return 0;
  const auto middle = altitudes.begin() + static_cast<std::ptrdiff_t>(altitudes.size() / 2);
  std::nth_element(altitudes.begin(), middle, altitudes.end());
  return std::min(1e-6 * diagonal, weld_share_of_altitude * *middle);
}

// Cells much larger than the tolerance: most points then have to look into one cell only.
VertexWelder::VertexWelder(double tolerance)
    : tolerance_(tolerance), cell_size_(std::max(32 * tolerance, std::numeric_limits<double>::min())) {}

std::size_t VertexWelder::Hash::operator()(const Key& key) const noexcept {
  std::uint64_t h = 0x9e3779b97f4a7c15u;
  for (const std::int64_t k : key) {
    h ^= static_cast<std::uint64_t>(k);
    h *= 0xff51afd7ed558ccdu;
    h ^= h >> 32;
  }
  return static_cast<std::size_t>(h);
}

std::int64_t VertexWelder::cell(double x) const {
  constexpr double largest = 9e18;
  return static_cast<std::int64_t>(std::clamp(std::floor(x / cell_size_), -largest, largest));
}

std::uint32_t VertexWelder::add(Vec3 p, const Key& exact) {
  if (points_.size() >= none) throw Error(ErrorKind::limit, "the patches have more than 4 billion vertices");
  const auto index = static_cast<std::uint32_t>(points_.size());
  points_.push_back(p);
  exact_.emplace(exact, index);
  const auto [entry, added] = cells_.try_emplace({cell(p.x), cell(p.y), cell(p.z)}, index);
  next_.push_back(added ? none : entry->second);
  entry->second = index;
  return index;
}

std::uint32_t VertexWelder::index_of(Vec3 p, double tolerance) {
  p = p + Vec3{};  // -0 becomes +0
  const Key exact{std::bit_cast<std::int64_t>(p.x), std::bit_cast<std::int64_t>(p.y), std::bit_cast<std::int64_t>(p.z)};
  if (const auto found = exact_.find(exact); found != exact_.end()) return found->second;
  tolerance = std::min(tolerance, tolerance_);
  if (!(tolerance > 0)) return add(p, exact);

  const Vec3 reach{tolerance, tolerance, tolerance};
  const Vec3 low = p - reach, high = p + reach;
  const Key first{cell(low.x), cell(low.y), cell(low.z)}, last{cell(high.x), cell(high.y), cell(high.z)};
  std::uint32_t best = none;
  double best_distance = tolerance;
  for (std::int64_t x = first[0]; x <= last[0]; ++x) {
    for (std::int64_t y = first[1]; y <= last[1]; ++y) {
      for (std::int64_t z = first[2]; z <= last[2]; ++z) {
        const auto found = cells_.find({x, y, z});
        if (found == cells_.end()) continue;
        std::uint32_t candidate = found->second;
        for (int seen = 0; candidate != none && seen < 64; ++seen, candidate = next_[candidate]) {
          const double distance = length(points_[candidate] - p);
          if (distance < best_distance || (distance <= best_distance && candidate < best)) {
            best = candidate;
            best_distance = distance;
          }
        }
      }
    }
  }
  return best != none ? best : add(p, exact);
}

}  // namespace interflect
