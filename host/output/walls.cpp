#include "interflect/output/walls.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "interflect/output/cut_parts.h"
#include "interflect/output/hanging.h"

namespace interflect {

namespace {

/// A foot of patch `wall` on patch `patch`.
struct Foot {
  std::uint32_t patch = 0, wall = 0;
  Cut::Segment at{};
};

/// A patch's plane with its (u, v).
struct Frame {
  Vec3 origin, normal, u, v;  ///< (p − origin)·u and ·v are the coordinates
  double side = 0;            ///< √(2 area): a length of the patch
};

std::vector<Frame> frames(const PatchMesh& mesh) {
  std::vector<Frame> out(mesh.size());
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const auto t = mesh.triangle(i);
    const Vec3 b = t[1] - t[0], c = t[2] - t[0], n = cross(b, c);
    const double scale = dot(n, n);
    out[i] = {t[0], mesh.normal[i], cross(c, n) / scale, cross(n, b) / scale, std::sqrt(2 * mesh.area[i])};
  }
  return out;
}

/// The part of a segment within the triangle u, v >= 0, u + v <= 1, or just beside it: a wall on an edge may be off by
/// rounding.
std::optional<Cut::Segment> clip(Cut::Segment s) {
  const Vec2 d{s[1].x - s[0].x, s[1].y - s[0].y};
  double from = 0, to = 1;
  const auto keep = [&](double at, double rate) {  // at + rate t >= 0
    at += 1e-3;
    if (rate > 0) from = std::max(from, -at / rate);
    if (rate < 0) to = std::min(to, -at / rate);
    return rate != 0 || at >= 0;
  };
  if (!keep(s[0].x, d.x) || !keep(s[0].y, d.y) || !keep(1 - s[0].x - s[0].y, -d.x - d.y) || !(from < to)) {
    return std::nullopt;
  }
  return Cut::Segment{Vec2{s[0].x + from * d.x, s[0].y + from * d.y}, Vec2{s[0].x + to * d.x, s[0].y + to * d.y}};
}

class Finder {
 public:
  Finder(const PatchMesh& mesh, const Continues& continues)
      : mesh_(mesh), continues_(continues), frames_(frames(mesh)) {
    low_.resize(mesh.size());
    high_.resize(mesh.size());
    Vec3 low{}, high{};
    for (std::size_t i = 0; i < mesh.size(); ++i) {
      const auto t = mesh.triangle(i);
      low_[i] = min(t[0], min(t[1], t[2])), high_[i] = max(t[0], max(t[1], t[2]));
      low = i == 0 ? low_[i] : min(low, low_[i]), high = i == 0 ? high_[i] : max(high, high_[i]);
    }
    const Vec3 size = high - low;
    axis_ = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    height_ = 2e-6 * length(size);
  }

  /// Every foot of every wall, by patch. Patches are swept along the scene's longest axis.
  [[nodiscard]] std::vector<Foot> all() const {
    std::vector<std::uint32_t> order(mesh_.size());
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(), [&](std::uint32_t i, std::uint32_t j) {
      return std::pair(low_[i][axis_], i) < std::pair(low_[j][axis_], j);
    });
    std::vector<Foot> feet;
#pragma omp parallel
    {
      std::vector<Foot> mine;
#pragma omp for schedule(dynamic, 64) nowait
      for (std::size_t a = 0; a < order.size(); ++a) {
        const std::uint32_t i = order[a];
        for (std::size_t b = a + 1; b < order.size() && low_[order[b]][axis_] <= high_[i][axis_] + height_; ++b) {
          if (!near(i, order[b])) continue;
          add(i, order[b], mine);
          add(order[b], i, mine);
        }
      }
#pragma omp critical(interflect_walls)
      feet.insert(feet.end(), mine.begin(), mine.end());
    }
    std::sort(feet.begin(), feet.end(),
              [](const Foot& f, const Foot& g) { return std::pair(f.patch, f.wall) < std::pair(g.patch, g.wall); });
    return feet;
  }

  /// How far a foot may lie from an edge of a patch to stand on it, as a share of the patch's height over that edge.
  [[nodiscard]] double beside(std::uint32_t i, std::size_t edge) const {
    const auto t = mesh_.triangle(i);
    const double altitude = 2 * mesh_.area[i] / length(t[(edge + 1) % 3] - t[edge]);
    return std::max(2e-3, 2 * height_ / (steepness * altitude));
  }

 private:
  static constexpr double steepness = 0.1;  // sine of the least angle between a wall and what it stands on

  [[nodiscard]] bool near(std::uint32_t i, std::uint32_t j) const {
    for (int axis = 0; axis < 3; ++axis) {
      if (low_[i][axis] > high_[j][axis] + height_ || low_[j][axis] > high_[i][axis] + height_) return false;
    }
    return true;
  }

  /// The foot of `wall` on the front of `patch`: where it passes through a plane just above it, so that one that only
  /// touches it, with or without common vertices, is met as well as one that goes through.
  void add(std::uint32_t patch, std::uint32_t wall, std::vector<Foot>& feet) const {
    const Frame& f = frames_[patch];
    const auto t = mesh_.triangle(wall);
    const std::array<double, 3> d{dot(f.normal, t[0] - f.origin) - height_, dot(f.normal, t[1] - f.origin) - height_,
                                  dot(f.normal, t[2] - f.origin) - height_};
    const auto [least, most] = std::minmax({d[0], d[1], d[2]});
    if (least >= 0 || most <= 20 * height_) return;
    if (length(cross(f.normal, mesh_.normal[wall])) < steepness || continues_(patch, wall)) return;
    Cut::Segment foot{};
    std::size_t ends = 0;
    for (std::size_t k = 0; k < 3 && ends < 2; ++k) {
      const std::size_t l = (k + 1) % 3;
      if ((d[k] < 0) == (d[l] < 0)) continue;
      const Vec3 p = t[k] + (t[l] - t[k]) * (d[k] / (d[k] - d[l])) - f.origin;
      foot[ends++] = {dot(p, f.u), dot(p, f.v)};
    }
    if (ends < 2) return;
    const auto inside = clip(foot);
    if (!inside) return;
    const auto& corners = mesh_.triangle(patch);
    const Vec3 along = (corners[1] - corners[0]) * ((*inside)[1].x - (*inside)[0].x) +
                       (corners[2] - corners[0]) * ((*inside)[1].y - (*inside)[0].y);
    if (length(along) < 2e-3 * f.side) return;  // a touch at a corner
    feet.push_back({patch, wall, *inside});
  }

  const PatchMesh& mesh_;
  const Continues& continues_;
  std::vector<Frame> frames_;
  std::vector<Vec3> low_, high_;
  int axis_ = 0;
  double height_ = 0;  ///< of that plane above a patch
};

/// How far a point is from edge k, as a share of the height over it, and where along it.
std::array<double, 2> edge_coordinates(Vec2 p, std::size_t k) {
  const double w = 1 - p.x - p.y;
  return k == 0 ? std::array{p.y, p.x} : k == 1 ? std::array{w, p.y} : std::array{p.x, w};
}

}  // namespace

Walls::Walls(const PatchMesh& mesh, const Continues& continues) {
  const Finder finder(mesh, continues);
  const std::vector<Foot> feet = finder.all();
  for (std::size_t first = 0; first < feet.size();) {
    const std::uint32_t patch = feet[first].patch;
    std::vector<Cut::Segment> inside;
    std::size_t last = first;
    for (; last < feet.size() && feet[last].patch == patch; ++last) {
      const Cut::Segment& s = feet[last].at;
      std::optional<OnEdge> edge;
      for (std::uint32_t k = 0; k < 3 && !edge; ++k) {
        const auto [away, from] = edge_coordinates(s[0], k);
        const auto [away_too, to] = edge_coordinates(s[1], k);
        if (std::max(away, away_too) < finder.beside(patch, k)) {
          edge = OnEdge{patch, k, std::min(from, to), std::max(from, to)};
        }
      }
      if (edge) {
        edges_.push_back(*edge);
      } else {
        inside.push_back(s);
      }
    }
    first = last;
    if (inside.empty()) continue;
    const auto t = mesh.triangle(patch);
    if (auto cut = cut_of(std::move(inside), t[1] - t[0], t[2] - t[0])) {
      index_.resize(mesh.size(), none);
      index_[patch] = static_cast<std::uint32_t>(cuts_.size());
      cuts_.push_back(std::move(*cut));
    }
  }
}

bool Walls::on_edge(std::uint32_t i, std::size_t k, double t) const {
  constexpr double gap = 4e-3;  // between the feet of a wall's patches, see cut_of()
  auto it =
      std::lower_bound(edges_.begin(), edges_.end(), i, [](const OnEdge& e, std::uint32_t p) { return e.patch < p; });
  for (; it != edges_.end() && it->patch == i; ++it) {
    if (it->edge == k && it->from - gap <= t && t <= it->to + gap) return true;
  }
  return false;
}

}  // namespace interflect
