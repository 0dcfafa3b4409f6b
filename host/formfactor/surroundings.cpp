#include "interflect/formfactor/surroundings.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include "interflect/formfactor/sampling.h"

namespace interflect {

namespace {

constexpr double lift_of_extent = 2e-6;  // as the shadow rays
constexpr double next_to_all = 0.9;      // of a point's rays
constexpr std::size_t most_open_edges = 1 << 14;
constexpr std::uint32_t most_escapes_followed = 32;

std::array<std::uint32_t, 3> turned(std::array<std::uint32_t, 3> t) {  // smallest index first, orientation kept
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

/// Malley's method about the unit normal n.
Vec3 cosine_direction(Vec3 n, double s, double t) {
  const Vec3 other = std::abs(n.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 u = normalized(cross(other, n)), v = cross(n, u);
  const double r = std::sqrt(s), phi = 2 * std::numbers::pi * t;
  return r * std::cos(phi) * u + r * std::sin(phi) * v + std::sqrt(1 - s) * n;
}

Visibility::Ray ray(Vec3 from, Vec3 d) {
  const auto f = [](double x) { return static_cast<float>(x); };
  return {{f(from.x), f(from.y), f(from.z)}, 0, {f(d.x), f(d.y), f(d.z)}, std::numeric_limits<float>::infinity()};
}

/// The most frequent key, the smallest of several.
std::optional<std::uint32_t> most(const std::map<std::uint32_t, std::uint32_t>& counts) {
  const auto best =
      std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return best == counts.end() ? std::nullopt : std::optional(best->first);
}

}  // namespace

Surroundings::Shape Surroundings::shape(const PatchMesh& mesh, const PatchTable& patches) {
  Shape out;
  for (const Vec3 p : mesh.vertices) out.vertices.push_back(p - patches.centre);
  std::map<std::array<std::uint32_t, 3>, std::size_t> seen;
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const auto& c = mesh.corners[i];
    if (const auto opposite = seen.find(turned({c[0], c[2], c[1]})); opposite != seen.end()) {
      out.two_sided[opposite->second] = true;
      continue;
    }
    seen.emplace(turned(c), out.triangles.size());
    out.triangles.push_back(c);
    out.patch.push_back(i);
    out.two_sided.push_back(false);
  }
  return out;
}

Surroundings::Surroundings(const PatchMesh& mesh, const PatchTable& patches)
    : mesh_(mesh),
      patches_(patches),
      shape_(shape(mesh, patches)),
      visibility_(shape_.vertices, shape_.triangles),
      edges_(edges_of(mesh)) {}

/// The surface of the open edge whose middle the ray passes nearest, as an angle.
std::optional<std::uint32_t> Surroundings::edge_near(Vec3 from, Vec3 direction) const {
  double nearest = -1;
  std::optional<std::uint32_t> surface;
  const std::size_t step = edges_.open.size() / most_open_edges + 1;
  for (std::size_t k = 0; k < edges_.open.size(); k += step) {
    const MeshEdges::Open& edge = edges_.open[k];
    const Vec3 to = 0.5 * (shape_.vertices[edge.low] + shape_.vertices[edge.high]) - from;
    const double cosine = dot(normalized(to), direction);
    if (cosine <= nearest) continue;
    nearest = cosine;
    surface = mesh_.surface[edge.patch];
  }
  return surface;
}

Around Surroundings::look(std::uint32_t patch) const {
  const auto corners = patches_.triangle(patch);
  const Vec3 n = patches_.front(patch), ab = corners[1] - corners[0], ac = corners[2] - corners[0];
  const std::uint64_t h = sampling::hash(0x6c6f6f6b, patch), g = sampling::hash(h, patch);
  const auto word = [](std::uint64_t w, bool high) { return static_cast<std::uint32_t>(high ? w >> 32 : w); };
  const auto& step = sampling::step4;
  Around out;
  std::map<std::uint32_t, std::uint32_t> backs, edges;
  std::uint32_t followed = 0;
  for (std::uint32_t p = 0; p < points; ++p) {
    const auto [u, v] = sampling::in_triangle(sampling::unit(word(h, false) + p * sampling::step2[0]),
                                              sampling::unit(word(h, true) + p * sampling::step2[1]));
    const Vec3 from =
        corners[0] + static_cast<double>(u) * ab + static_cast<double>(v) * ac + lift_of_extent * patches_.extent * n;
    std::uint32_t blind = 0, behind = 0;
    for (std::uint32_t k = p * directions; k < (p + 1) * directions; ++k) {
      const Vec3 d = cosine_direction(n, static_cast<double>(sampling::unit(word(g, false) + k * step[2])),
                                      static_cast<double>(sampling::unit(word(g, true) + k * step[3])));
      const auto hit = visibility_.closest(ray(from, d));
      if (!hit) {
        out.escape += 1;
        ++blind;
        if (followed++ >= most_escapes_followed) continue;
        if (const auto surface = edge_near(from, d)) ++edges[*surface];
        continue;
      }
      if (static_cast<double>(hit->t) < patches_.radius[patch]) out.near += 1;
      if (hit->front || shape_.two_sided[hit->triangle]) continue;
      const std::uint32_t other = shape_.patch[hit->triangle];
      out.back += 1;
      ++blind;
      ++behind;
      if (edges_.turned[other]) out.back_of_turned += 1;
      ++backs[mesh_.surface[other]];
    }
    if (behind > 0 && blind >= next_to_all * directions) out.inside += 1;
  }
  for (double* share : {&out.escape, &out.back, &out.back_of_turned, &out.near}) *share /= points * directions;
  out.inside /= points;
  out.back_surface = most(backs);
  out.edge_surface = most(edges);
  return out;
}

}  // namespace interflect
