#include "interflect/formfactor/blockers.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

namespace interflect {

namespace {

using Indices = std::array<std::uint32_t, 3>;
using kernel::Plane;

constexpr std::size_t cluster = 8;

Indices turned(Indices t) {  // smallest index first, orientation kept
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

/// The triangle that consecutive patches tile, if they do: the corner farthest from some point, the one farthest from
/// that, and the one farthest from their line; its area must be the patches' sum and its front theirs.
std::optional<Indices> tiled(const std::vector<Vec3>& at, std::span<const Indices> tiles) {
  const auto farthest = [&](const auto& measure) {
    std::uint32_t best = tiles[0][0];
    double most = -1;
    for (const Indices& t : tiles) {
      for (const std::uint32_t v : t) {
        const double m = measure(at[v]);
        if (m > most) {
          most = m;
          best = v;
        }
      }
    }
    return best;
  };
  const auto twice = [&](const Indices& t) { return cross(at[t[1]] - at[t[0]], at[t[2]] - at[t[0]]); };
  const Vec3 start = at[tiles[0][0]];
  const std::uint32_t a = farthest([&](Vec3 p) { return length(p - start); });
  const std::uint32_t b = farthest([&](Vec3 p) { return length(p - at[a]); });
  const std::uint32_t c = farthest([&](Vec3 p) { return length(cross(p - at[a], at[b] - at[a])); });
  Indices whole{a, b, c};
  Vec3 sum{};
  double areas = 0;
  for (const Indices& t : tiles) {
    sum += twice(t);
    areas += length(twice(t));
  }
  if (dot(sum, twice(whole)) < 0) std::swap(whole[1], whole[2]);
  constexpr double rounding = 1e-9;
  const bool covers = std::abs(length(twice(whole)) - areas) <= rounding * areas;
  const bool flat = length(sum - twice(whole)) <= rounding * areas;
  return covers && flat ? std::optional(whole) : std::nullopt;
}

double farthest_along(const Box& box, Vec3 n) {
  return dot(n, {n.x > 0 ? box.high.x : box.low.x, n.y > 0 ? box.high.y : box.low.y, n.z > 0 ? box.high.z : box.low.z});
}

bool disjoint(const Box& a, const Box& b, double slack) {
  return a.low.x > b.high.x + slack || b.low.x > a.high.x + slack || a.low.y > b.high.y + slack ||
         b.low.y > a.high.y + slack || a.low.z > b.high.z + slack || b.low.z > a.high.z + slack;
}

/// `most(n)`: the largest n·x of the body.
template <class Most>
bool outside(const Shaft& shaft, const Most& most) {
  for (std::size_t k = 0; k < shaft.sides; ++k) {
    if (-most(-shaft.side[k].normal) - shaft.side[k].offset > shaft.slack) return true;
  }
  const auto behind = [&](const std::vector<Plane>& planes) {
    return std::all_of(planes.begin(), planes.end(),
                       [&](const Plane& p) { return most(p.normal) - p.offset <= shaft.behind; });
  };
  return behind(shaft.from) || behind(shaft.to);
}

}  // namespace

Shaft::Shaft(const Box& a, const Box& b, double gap) : around{min(a.low, b.low), max(a.high, b.high)}, slack(gap) {
  // Seen along each axis the hull of two rectangles has sides that join equal corners of both.
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool high_u : {false, true}) {
      for (const bool high_v : {false, true}) {
        const auto corner = [&](const Box& box) {
          return std::array<double, 2>{(high_u ? box.high : box.low)[u], (high_v ? box.high : box.low)[v]};
        };
        const auto p = corner(a), q = corner(b);
        std::array<double, 2> n{q[1] - p[1], p[0] - q[0]};
        const double size = std::hypot(n[0], n[1]);
        if (!(size > 0)) continue;
        const double sign = (high_u ? n[0] : -n[0]) + (high_v ? n[1] : -n[1]) >= 0 ? 1 / size : -1 / size;
        n = {n[0] * sign, n[1] * sign};
        std::array<double, 3> normal{};
        normal[static_cast<std::size_t>(u)] = n[0];
        normal[static_cast<std::size_t>(v)] = n[1];
        const Plane plane{{normal[0], normal[1], normal[2]}, n[0] * p[0] + n[1] * p[1]};
        const double most = std::max(farthest_along(a, plane.normal), farthest_along(b, plane.normal));
        if (most <= plane.offset + 0.5 * slack) side[sides++] = plane;
      }
    }
  }
}

Blockers::Shape Blockers::shape(const PatchMesh& mesh, const PatchTable& patches) {
  Shape out;
  for (const Vec3 p : mesh.vertices) out.vertices.push_back(p - patches.centre);
  std::vector<Indices> triangles;
  std::vector<bool> two_sided;
  std::vector<std::uint32_t> source;
  std::map<Indices, std::size_t> seen;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const Indices& corners = mesh.corners[i];
    const auto opposite = seen.find(turned({corners[0], corners[2], corners[1]}));
    if (opposite != seen.end()) {
      two_sided[opposite->second] = true;
      continue;
    }
    seen.emplace(turned(corners), triangles.size());
    triangles.push_back(corners);
    two_sided.push_back(false);
    source.push_back(mesh.source[i]);
  }
  for (std::size_t first = 0, end = 0; first < source.size(); first = end) {
    while (end < source.size() && source[end] == source[first] && two_sided[end] == two_sided[first]) ++end;
    const std::span tiles(triangles.data() + first, end - first);
    if (const auto whole = tiled(out.vertices, tiles)) {
      out.triangles.push_back(*whole);
    } else {
      out.triangles.insert(out.triangles.end(), tiles.begin(), tiles.end());
    }
    out.two_sided.resize(out.triangles.size(), two_sided[first]);
  }
  return out;
}

Blockers::Blockers(const PatchMesh& mesh, const PatchTable& patches) : Blockers(shape(mesh, patches)) {}

Blockers::Blockers(std::vector<Vec3> vertices, std::vector<std::array<std::uint32_t, 3>> triangles)
    : Blockers(Shape{std::move(vertices), triangles, std::vector<bool>(triangles.size())}) {}

Blockers::Blockers(Shape shape) : shape_(std::move(shape)), visibility_(shape_.vertices, shape_.triangles) {
  for (std::size_t first = 0; first < shape_.triangles.size(); first += cluster) {
    const Vec3 start = shape_.vertices[shape_.triangles[first][0]];
    Box box{start, start};
    for (std::size_t t = first; t < std::min(first + cluster, shape_.triangles.size()); ++t) {
      for (const std::uint32_t v : shape_.triangles[t]) {
        box = {min(box.low, shape_.vertices[v]), max(box.high, shape_.vertices[v])};
      }
    }
    clusters_.push_back(box);
  }
}

bool Blockers::cluster_in(const Shaft& shaft, std::size_t c) const {
  const Box& box = clusters_[c];
  if (disjoint(box, shaft.around, shaft.slack)) return false;
  if (outside(shaft, [&](Vec3 n) { return farthest_along(box, n); })) return false;
  for (std::size_t t = c * cluster; t < std::min((c + 1) * cluster, shape_.triangles.size()); ++t) {
    const Vec3 p = shape_.vertices[shape_.triangles[t][0]], q = shape_.vertices[shape_.triangles[t][1]],
               r = shape_.vertices[shape_.triangles[t][2]];
    if (disjoint({min(p, min(q, r)), max(p, max(q, r))}, shaft.around, shaft.slack)) continue;
    if (!outside(shaft, [&](Vec3 n) { return std::max({dot(n, p), dot(n, q), dot(n, r)}); })) return true;
  }
  return false;
}

bool Blockers::any_in(const Shaft& shaft, std::size_t& hint) const {
  if (hint < clusters_.size() && cluster_in(shaft, hint)) return true;
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    if (!cluster_in(shaft, c)) continue;
    hint = c;
    return true;
  }
  return false;
}

}  // namespace interflect
