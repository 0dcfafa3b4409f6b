#include "interflect/output/charts.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace interflect {

namespace {

// A wall that its four corners leave not quite flat is one chart; no length in it changes by more than 2e-4.
constexpr double flat_cosine = 1 - 2e-4;  // 0.02 radians
constexpr double flat_distance = 0.005;   // of the scene's diagonal
constexpr auto none = std::numeric_limits<std::uint32_t>::max();

/// One side of a triangle of the model: patches [first, end).
struct Side {
  std::uint32_t first = 0, end = 0;
  std::array<std::uint32_t, 3> corner{};  ///< into PatchMesh::vertices
};

/// The corners of the triangle that the patches fill: the point of a triangle that is farthest from any point is a
/// corner, and so is the one farthest from the line through two corners.
std::array<std::uint32_t, 3> corners_of(const PatchMesh& mesh, std::uint32_t first, std::uint32_t end) {
  if (end - first == 1) return mesh.corners[first];
  const auto farthest = [&](const auto& distance) {
    std::uint32_t best = mesh.corners[first][0];
    double most = -1;
    for (std::uint32_t i = first; i < end; ++i) {
      for (const std::uint32_t v : mesh.corners[i]) {
        const double d = distance(mesh.vertices[v]);
        if (d > most) most = d, best = v;
      }
    }
    return best;
  };
  const Vec3 start = mesh.centroid[first];
  const std::uint32_t a = farthest([&](Vec3 p) { return length(p - start); });
  const std::uint32_t b = farthest([&](Vec3 p) { return length(p - mesh.vertices[a]); });
  const Vec3 along = normalized(mesh.vertices[b] - mesh.vertices[a]);
  const std::uint32_t c = farthest([&](Vec3 p) { return length(cross(p - mesh.vertices[a], along)); });
  return {a, b, c};
}

std::vector<Side> sides_of(const PatchMesh& mesh) {
  std::vector<Side> sides;
  for (std::uint32_t i = 0; i < mesh.size();) {
    Side side{i, i, {}};
    while (side.end < mesh.size() && mesh.source[side.end] == mesh.source[i] &&
           dot(mesh.normal[side.end], mesh.normal[i]) > 0) {
      ++side.end;
    }
    side.corner = corners_of(mesh, side.first, side.end);
    sides.push_back(side);
    i = side.end;
  }
  return sides;
}

/// An edge of a side, from the smaller vertex to the larger.
struct Edge {
  std::array<std::uint32_t, 2> ends{};
  std::uint32_t side = 0;
  auto operator<=>(const Edge&) const = default;
};

/// The sides' edges in order, and for each side where its three lie.
struct Edges {
  std::vector<Edge> sorted;
  std::vector<std::array<std::size_t, 3>> group;  ///< per side and edge: the first in `sorted` with the same ends

  explicit Edges(const std::vector<Side>& sides) : group(sides.size()) {
    for (std::uint32_t s = 0; s < sides.size(); ++s) {
      for (std::size_t k = 0; k < 3; ++k) sorted.push_back(edge(sides[s], k, s));
    }
    std::sort(sorted.begin(), sorted.end());
    for (std::uint32_t s = 0; s < sides.size(); ++s) {
      for (std::size_t k = 0; k < 3; ++k) {
        const auto first = std::lower_bound(sorted.begin(), sorted.end(), edge(sides[s], k, 0));
        group[s][k] = static_cast<std::size_t>(first - sorted.begin());
      }
    }
  }
  static Edge edge(const Side& side, std::size_t k, std::uint32_t index) {
    const auto [low, high] = std::minmax(side.corner[k], side.corner[(k + 1) % 3]);
    return {{low, high}, index};
  }
};

/// The sides that lie with `seed` in one plane and hang together with it over edges.
class Growth {
 public:
  Growth(const PatchMesh& mesh, const std::vector<Side>& sides)
      : mesh_(mesh), sides_(sides), edges_(sides), used_(sides.size(), false), expanded_(edges_.sorted.size(), none) {
    Vec3 low = mesh.vertices.front(), high = low;
    for (const Vec3 v : mesh.vertices) low = min(low, v), high = max(high, v);
    distance_ = flat_distance * length(high - low);
  }
  [[nodiscard]] bool used(std::uint32_t side) const { return used_[side]; }

  std::vector<std::uint32_t> from(std::uint32_t seed) {
    std::vector<std::uint32_t> found{seed};
    used_[seed] = true;
    for (std::size_t at = 0; at < found.size(); ++at) {
      for (const std::size_t group : edges_.group[found[at]]) {
        if (expanded_[group] == seed) continue;
        expanded_[group] = seed;
        const auto& ends = edges_.sorted[group].ends;
        for (std::size_t k = group; k < edges_.sorted.size() && edges_.sorted[k].ends == ends; ++k) {
          const std::uint32_t other = edges_.sorted[k].side;
          if (used_[other] || !in_plane(seed, other)) continue;
          used_[other] = true;
          found.push_back(other);
        }
      }
    }
    std::sort(found.begin(), found.end());
    return found;
  }

 private:
  [[nodiscard]] bool in_plane(std::uint32_t seed, std::uint32_t other) const {
    const std::uint32_t i = sides_[seed].first, j = sides_[other].first;
    if (mesh_.surface[i] != mesh_.surface[j] || dot(mesh_.normal[i], mesh_.normal[j]) < flat_cosine) return false;
    const auto& corners = sides_[other].corner;
    return std::all_of(corners.begin(), corners.end(), [&](std::uint32_t v) {
      return std::abs(dot(mesh_.vertices[v] - mesh_.centroid[i], mesh_.normal[i])) <= distance_;
    });
  }

  const PatchMesh& mesh_;
  const std::vector<Side>& sides_;
  Edges edges_;
  std::vector<bool> used_;
  std::vector<std::uint32_t> expanded_;  ///< per group of edges: the last seed that looked through it
  double distance_ = 0;
};

/// Some frame of the plane of patch i: x along its longest edge.
Chart plane_of(const PatchMesh& mesh, std::uint32_t i) {
  const auto corners = mesh.triangle(i);
  Vec3 longest{};
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 edge = corners[(k + 1) % 3] - corners[k];
    if (length(edge) > length(longest)) longest = edge;
  }
  const Vec3 n = mesh.normal[i];
  const Vec3 across = normalized(longest - n * dot(longest, n));
  return {{}, mesh.centroid[i], across, cross(across, n), 0, 0};
}

double turn(Vec2 a, Vec2 b, Vec2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// The convex hull, counter-clockwise (Andrew's monotone chain).
std::vector<Vec2> hull(std::vector<Vec2> points) {
  std::sort(points.begin(), points.end(), [](Vec2 a, Vec2 b) { return std::pair(a.x, a.y) < std::pair(b.x, b.y); });
  points.erase(std::unique(points.begin(), points.end()), points.end());
  std::vector<Vec2> out;
  const auto half = [&] {
    const std::size_t start = out.size();
    for (const Vec2 p : points) {
      while (out.size() >= start + 2 && turn(out[out.size() - 2], out.back(), p) <= 0) out.pop_back();
      out.push_back(p);
    }
    out.pop_back();
    std::reverse(points.begin(), points.end());
  };
  half(), half();
  return out;
}

/// Turns and moves the chart's frame so that the smallest rectangle around the points, one side of which lies along an
/// edge of their hull, begins at (0, 0) and is at least as wide as high.
void fit(Chart& chart, const std::vector<Vec2>& points) {
  const std::vector<Vec2> rim = hull(points);
  double smallest = std::numeric_limits<double>::max();
  const Chart plane = chart;
  for (std::size_t k = 0; k < rim.size(); ++k) {
    const Vec2 from = rim[k], to = rim[(k + 1) % rim.size()];
    const double size = std::hypot(to.x - from.x, to.y - from.y);
    if (!(size > 0)) continue;
    const double c = (to.x - from.x) / size, s = (to.y - from.y) / size;
    Vec2 low{1e300, 1e300}, high{-1e300, -1e300};
    for (const Vec2 p : rim) {
      const double x = c * p.x + s * p.y, y = c * p.y - s * p.x;
      low = {std::min(low.x, x), std::min(low.y, y)}, high = {std::max(high.x, x), std::max(high.y, y)};
    }
    const double width = high.x - low.x, height = high.y - low.y;
    if (!(width * height < smallest * (1 - 1e-9))) continue;  // of equal ones the first
    smallest = width * height;
    const Vec3 x = plane.across * c + plane.down * s, y = plane.down * c - plane.across * s;
    if (width >= height) {
      chart.origin = plane.origin + x * low.x + y * low.y;
      chart.across = x, chart.down = y, chart.width = width, chart.height = height;
    } else {  // a quarter turn, which keeps the handedness
      chart.origin = plane.origin + x * high.x + y * low.y;
      chart.across = y, chart.down = -x, chart.width = height, chart.height = width;
    }
  }
}

}  // namespace

Charts flat_charts(const PatchMesh& mesh) {
  const std::vector<Side> sides = sides_of(mesh);
  Growth growth(mesh, sides);
  Charts charts;
  charts.of_patch.assign(mesh.size(), none);
  for (std::uint32_t seed = 0; seed < sides.size(); ++seed) {
    if (growth.used(seed)) continue;
    const std::vector<std::uint32_t> members = growth.from(seed);
    const Chart plane = plane_of(mesh, sides[seed].first);
    std::vector<Triangle2> outlines;
    Vec2 low{1e300, 1e300}, high{-1e300, -1e300};
    for (const std::uint32_t m : members) {
      Triangle2& t = outlines.emplace_back();
      for (std::size_t c = 0; c < 3; ++c) {
        t[c] = plane.place(mesh.vertices[sides[m].corner[c]]);
        low = {std::min(low.x, t[c].x), std::min(low.y, t[c].y)};
        high = {std::max(high.x, t[c].x), std::max(high.y, t[c].y)};
      }
    }
    const double slack = 1e-6 * std::hypot(high.x - low.x, high.y - low.y);
    const std::vector<std::uint32_t> layer = layers_without_overlap(outlines, slack);
    const std::size_t first = charts.list.size();
    const std::uint32_t layers = 1 + *std::max_element(layer.begin(), layer.end());
    charts.list.resize(first + layers, plane);
    std::vector<std::vector<Vec2>> points(layers);
    for (std::size_t k = 0; k < members.size(); ++k) {
      const Side& side = sides[members[k]];
      for (std::uint32_t i = side.first; i < side.end; ++i) {
        charts.list[first + layer[k]].patches.push_back(i);
        charts.of_patch[i] = static_cast<std::uint32_t>(first + layer[k]);
        for (const Vec3 p : mesh.triangle(i)) points[layer[k]].push_back(plane.place(p));
      }
    }
    for (std::size_t l = 0; l < layers; ++l) fit(charts.list[first + l], points[l]);
  }
  return charts;
}

}  // namespace interflect
