#include "interflect/output/hanging.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <unordered_map>

namespace interflect {

namespace {

/// Mesh vertices by position, within a millionth of the scene's size.
class VertexGrid {
 public:
  explicit VertexGrid(const std::vector<Vec3>& vertices) : vertices_(vertices) {
    for (const Vec3& p : vertices) low_ = min(low_, p), high_ = max(high_, p);
    cell_ = std::max(1e-6 * length(high_ - low_), std::numeric_limits<double>::min());
    cells_.reserve(vertices.size());
    for (std::uint32_t v = 0; v < vertices.size(); ++v) cells_.emplace(key(vertices[v], {}), v);
  }

  [[nodiscard]] std::optional<std::uint32_t> at(Vec3 p) const {
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 shift{corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5};
      const auto [first, last] = cells_.equal_range(key(p, shift));
      for (auto it = first; it != last; ++it) {
        if (length(vertices_[it->second] - p) <= 0.5 * cell_) return it->second;
      }
    }
    return std::nullopt;
  }

 private:
  [[nodiscard]] std::uint64_t key(Vec3 p, Vec3 shift) const {
    std::uint64_t hash = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double steps = std::floor((p[axis] - low_[axis]) / cell_ + shift[axis]);
      hash = (hash ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(steps))) * 0x9E3779B97F4A7C15U;
      hash ^= hash >> 29;
    }
    return hash;
  }

  const std::vector<Vec3>& vertices_;
  static constexpr double far = std::numeric_limits<double>::max();
  Vec3 low_{far, far, far}, high_{-far, -far, -far};
  double cell_ = 1;
  std::unordered_multimap<std::uint64_t, std::uint32_t> cells_;
};

struct DirectedEdge {
  std::uint32_t from = 0, to = 0, patch = 0;
  bool operator<(const DirectedEdge& o) const { return std::tie(from, to, patch) < std::tie(o.from, o.to, o.patch); }
};

/// Whether a wall stands on the edge or goes through it: then its ends say nothing about its middle.
bool walled(const PatchMesh& mesh, const Walls& walls, const DirectedEdge& e) {
  std::size_t k = 0;
  while (mesh.corners[e.patch][k] != e.from) ++k;
  const Cut* cut = walls.cut(e.patch);
  return walls.on_edge(e.patch, k, 0.5) || (cut != nullptr && (cut->part[k] >> (k + 1) % 3 & 1U) == 0);
}

struct Search {
  const PatchMesh& mesh;
  const SmoothMesh& smooth;
  const Continues& continues;
  VertexGrid grid;
  std::vector<std::vector<std::uint32_t>> at_vertex;  ///< patches at a vertex; only where an edge was found unmatched
  std::vector<std::pair<double, SmoothMesh::Hanging>> found;

  /// The smooth vertex of the surface that continues patch i at mesh vertex v, if i has no corner there itself.
  [[nodiscard]] std::optional<std::uint32_t> continuation(std::uint32_t i, std::uint32_t v) const {
    for (const std::uint32_t j : at_vertex[v]) {
      if (j == i || !continues(i, j)) continue;
      for (std::size_t c = 0; c < 3; ++c) {
        if (mesh.corners[j][c] == v) return smooth.corners[j][c];
      }
    }
    return std::nullopt;
  }

  void halve(std::uint32_t i, std::uint32_t a, std::uint32_t b, int depth) {
    const Vec3 p = mesh.vertices[smooth.vertex[a]], q = mesh.vertices[smooth.vertex[b]];
    const auto middle = grid.at((p + q) / 2);
    if (!middle || depth == 0) return;
    const auto m = continuation(i, *middle);
    if (!m || *m == a || *m == b) return;
    found.emplace_back(length(q - p), SmoothMesh::Hanging{*m, {a, b}});
    halve(i, a, *m, depth - 1);
    halve(i, *m, b, depth - 1);
  }
};

}  // namespace

std::vector<SmoothMesh::Hanging> find_hanging(const PatchMesh& mesh, const SmoothMesh& smooth,
                                              const Continues& continues) {
  std::vector<DirectedEdge> edges;
  edges.reserve(3 * mesh.size());
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const auto& c = mesh.corners[i];
    for (std::size_t k = 0; k < 3; ++k) edges.push_back({c[k], c[(k + 1) % 3], i});
  }
  std::sort(edges.begin(), edges.end());
  const auto matched = [&](const DirectedEdge& e) {
    auto it = std::lower_bound(edges.begin(), edges.end(), DirectedEdge{e.to, e.from, 0});
    for (; it != edges.end() && it->from == e.to && it->to == e.from; ++it) {
      if (continues(e.patch, it->patch)) return true;
    }
    return false;
  };
  Search search{mesh, smooth, continues, VertexGrid(mesh.vertices), {}, {}};
  search.at_vertex.resize(mesh.vertices.size());
  for (const DirectedEdge& e : edges) search.at_vertex[e.from].push_back(e.patch);
  for (const DirectedEdge& e : edges) {
    if (matched(e) || walled(mesh, smooth.walls, e)) continue;
    std::array<std::uint32_t, 2> ends{};
    for (std::size_t c = 0; c < 3; ++c) {
      if (mesh.corners[e.patch][c] == e.from) ends[0] = smooth.corners[e.patch][c];
      if (mesh.corners[e.patch][c] == e.to) ends[1] = smooth.corners[e.patch][c];
    }
    search.halve(e.patch, ends[0], ends[1], 12);
  }
  // A vertex hangs on one edge only: the longest that claims it. Its ends may hang on longer edges themselves.
  std::stable_sort(search.found.begin(), search.found.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<bool> taken(smooth.size(), false);
  std::vector<SmoothMesh::Hanging> hanging;
  for (const auto& [edge, h] : search.found) {
    if (taken[h.vertex]) continue;
    taken[h.vertex] = true;
    hanging.push_back(h);
  }
  return hanging;
}

}  // namespace interflect
