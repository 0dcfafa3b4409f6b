#include "interflect/output/smooth.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <span>

#include "interflect/base/error.h"
#include "interflect/output/hanging.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

constexpr std::size_t small_fan = 64;

/// A patch's corner at the vertex in question, with the rays along its two edges from there.
struct Entry {
  std::uint32_t patch = 0;
  std::uint32_t corner = 0;
  std::array<std::uint32_t, 2> end{};
  std::array<Vec3, 2> ray{};
};

class FanUnion {
 public:
  explicit FanUnion(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), std::size_t{0}); }
  std::size_t find(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void unite(std::size_t i, std::size_t j) {
    i = find(i), j = find(j);
    parent_[std::max(i, j)] = std::min(i, j);
  }

 private:
  std::vector<std::size_t> parent_;
};

bool same_ray(const Entry& a, int i, const Entry& b, int j) {
  const auto p = static_cast<std::size_t>(i), q = static_cast<std::size_t>(j);
  // cos 0.0014: the shorter edge of a finer neighbour runs along the longer one.
  return a.end[p] == b.end[q] || dot(a.ray[p], b.ray[q]) > 1 - 1e-6;
}

/// Whether a wall that need not have a vertex here stands on edge i of a where it leaves the vertex.
bool walled(const Walls& walls, const Entry& a, int i) {
  constexpr double near = 0.01;
  // The ray to the next corner runs along the patch's edge of the same number, the other one back along the edge
  // before.
  return i == 0 ? walls.on_edge(a.patch, a.corner, near) : walls.on_edge(a.patch, (a.corner + 2) % 3, 1 - near);
}

/// Whether a wall runs from the vertex into the patch: what is left and right of it do not belong together.
bool split(const Walls& walls, const Entry& a) {
  const Cut* cut = walls.cut(a.patch);
  return cut != nullptr && cut->part[a.corner] == 0;
}

/// Whether a third patch rises from the edge that a and b share (a's edge i), on the front of both: a wall on a floor.
bool divided(const PatchMesh& mesh, std::span<const Entry> fan, const Entry& a, int i, const Entry& b) {
  const Vec3 along = a.ray[static_cast<std::size_t>(i)];
  for (const Entry& c : fan) {
    if (c.patch == a.patch || c.patch == b.patch) continue;
    for (int k = 0; k < 2; ++k) {
      if (!same_ray(a, i, c, k)) continue;
      const Vec3 other = c.ray[static_cast<std::size_t>(1 - k)];
      const Vec3 into = normalized(other - along * dot(other, along));
      if (dot(into, mesh.normal[a.patch]) > 0.1 && dot(into, mesh.normal[b.patch]) > 0.1) return true;
    }
  }
  return false;
}

void connect_small(const PatchMesh& mesh, std::span<const Entry> fan, const Continues& continues, const Walls& walls,
                   FanUnion& sets) {
  for (std::size_t a = 0; a < fan.size(); ++a) {
    for (std::size_t b = a + 1; b < fan.size(); ++b) {
      if (!continues(fan[a].patch, fan[b].patch) || split(walls, fan[a]) || split(walls, fan[b])) continue;
      for (int edges = 0; edges < 4; ++edges) {
        const int i = edges / 2, j = edges % 2;
        if (!same_ray(fan[a], i, fan[b], j) || divided(mesh, fan, fan[a], i, fan[b])) continue;
        if (!walled(walls, fan[a], i) && !walled(walls, fan[b], j)) sets.unite(a, b);
      }
    }
  }
}

/// Without the quadratic search: only patches that share an edge, found by its other end.
void connect_large(std::span<const Entry> fan, const Continues& continues, const Walls& walls, FanUnion& sets) {
  std::vector<std::pair<std::uint32_t, std::size_t>> ends;
  for (std::size_t a = 0; a < fan.size(); ++a) {
    for (const std::uint32_t end : fan[a].end) ends.emplace_back(end, a);
  }
  std::sort(ends.begin(), ends.end());
  for (std::size_t k = 0; k < ends.size(); ++k) {
    const std::size_t stop = std::min(ends.size(), k + 8);
    for (std::size_t l = k + 1; l < stop && ends[l].first == ends[k].first; ++l) {
      const Entry &a = fan[ends[k].second], &b = fan[ends[l].second];
      if (split(walls, a) || split(walls, b)) continue;
      if (walled(walls, a, a.end[0] == ends[k].first ? 0 : 1)) continue;
      if (continues(fan[ends[k].second].patch, fan[ends[l].second].patch)) sets.unite(ends[k].second, ends[l].second);
    }
  }
}

/// The corners around every vertex, as one array and where each vertex's part starts.
struct Fans {
  std::vector<std::size_t> start;
  std::vector<std::uint32_t> corner;  ///< 3 * patch + corner
};

Fans collect_fans(const PatchMesh& mesh) {
  Fans fans{std::vector<std::size_t>(mesh.vertices.size() + 1, 0), std::vector<std::uint32_t>(3 * mesh.size())};
  for (const auto& corners : mesh.corners) {
    for (const std::uint32_t v : corners) ++fans.start[v + 1];
  }
  std::partial_sum(fans.start.begin(), fans.start.end(), fans.start.begin());
  std::vector<std::size_t> next(fans.start.begin(), fans.start.end() - 1);
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    for (std::uint32_t c = 0; c < 3; ++c) fans.corner[next[mesh.corners[i][c]]++] = 3 * i + c;
  }
  return fans;
}

Entry make_entry(const PatchMesh& mesh, std::uint32_t corner) {
  Entry entry{corner / 3, corner % 3, {}, {}};
  const auto& corners = mesh.corners[entry.patch];
  const Vec3 here = mesh.vertices[corners[entry.corner]];
  for (std::uint32_t k = 0; k < 2; ++k) {
    entry.end[k] = corners[(entry.corner + 1 + k) % 3];
    entry.ray[k] = normalized(mesh.vertices[entry.end[k]] - here);
  }
  return entry;
}

}  // namespace

Continues::Continues(const PatchMesh& mesh, double crease) : mesh_(mesh), cosine_(std::cos(crease)) {}

bool Continues::operator()(std::uint32_t i, std::uint32_t j) const {
  const PatchMesh& m = mesh_;
  if (dot(m.normal[i], m.normal[j]) < cosine_) return false;
  if (emits(m.emittance[i]) != emits(m.emittance[j])) return false;
  if (m.surface[i] == m.surface[j]) return true;
  if (m.surfaces[m.surface[i]].material == m.surfaces[m.surface[j]].material) return true;
  return m.reflectance[i] == m.reflectance[j] && m.emittance[i] == m.emittance[j];
}

/// How much patch i's radiosity says about its corner k: its area; nothing where a good part of the patch lies on the
/// other side of a wall; next to nothing where a small one does, so that it counts where no whole patch is there.
double weight_of(const PatchMesh& mesh, const Walls& walls, std::uint32_t i, std::size_t k) {
  constexpr double nearly_all = 0.9, next_to_nothing = 1e-6;
  const Cut* cut = walls.cut(i);
  if (cut == nullptr) return mesh.area[i];
  return cut->share[k] >= nearly_all ? next_to_nothing * mesh.area[i] : 0;
}

/// The smooth vertices that no patch gives a value, each with neighbours on its own side of the walls that have one,
/// ring by ring.
std::vector<SmoothMesh::Filled> find_filled(const PatchMesh& mesh, const SmoothMesh& smooth) {
  std::vector<SmoothMesh::Filled> filled;
  if (smooth.walls.size() == 0) return filled;
  std::vector<bool> known(smooth.size(), false);
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (weight_of(mesh, smooth.walls, i, k) > 0) known[smooth.corners[i][k]] = true;
    }
  }
  std::vector<std::uint32_t> patches;  // with a corner that is not known
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const auto& c = smooth.corners[i];
    if (!known[c[0]] || !known[c[1]] || !known[c[2]]) patches.push_back(i);
  }
  for (bool more = true; more;) {
    std::map<std::uint32_t, std::vector<std::uint32_t>> ring;
    for (const std::uint32_t i : patches) {
      const Cut* cut = smooth.walls.cut(i);
      for (std::size_t k = 0; k < 3; ++k) {
        if (known[smooth.corners[i][k]]) continue;
        for (std::size_t l = 0; l < 3; ++l) {
          const bool here = cut == nullptr || (cut->part[k] >> l & 1U) != 0;
          if (here && known[smooth.corners[i][l]]) ring[smooth.corners[i][k]].push_back(smooth.corners[i][l]);
        }
      }
    }
    for (auto& [vertex, from] : ring) {
      known[vertex] = true;
      filled.push_back({vertex, std::move(from)});
    }
    more = !ring.empty();
  }
  return filled;
}

SmoothMesh smooth_mesh(const PatchMesh& mesh, double crease, bool walls) {
  const Continues continues(mesh, crease);
  const Fans fans = collect_fans(mesh);
  SmoothMesh smooth;
  if (walls) smooth.walls = Walls(mesh, continues);
  smooth.corners.resize(mesh.size());
  std::vector<Entry> fan;
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    fan.clear();
    for (std::size_t k = fans.start[v]; k < fans.start[v + 1]; ++k) fan.push_back(make_entry(mesh, fans.corner[k]));
    FanUnion sets(fan.size());
    if (fan.size() <= small_fan) {
      connect_small(mesh, fan, continues, smooth.walls, sets);
    } else {
      connect_large(fan, continues, smooth.walls, sets);
    }
    // A set's smallest member is its root, so it is numbered before the others ask for it.
    for (std::size_t k = 0; k < fan.size(); ++k) {
      const std::size_t root = sets.find(k);
      auto& slot = smooth.corners[fan[k].patch][fan[k].corner];
      if (root == k) {
        slot = static_cast<std::uint32_t>(smooth.size());
        smooth.vertex.push_back(v);
        smooth.normal.emplace_back();
      } else {
        slot = smooth.corners[fan[root].patch][fan[root].corner];
      }
      smooth.normal[slot] += mesh.normal[fan[k].patch] * mesh.area[fan[k].patch];
    }
  }
  for (Vec3& n : smooth.normal) n = normalized(n);
  smooth.hanging = find_hanging(mesh, smooth, continues);
  smooth.filled = find_filled(mesh, smooth);
  return smooth;
}

/// Values for the vertices that have none because walls stand on all their patches: from their neighbours, else, on
/// islands between walls, from those patches after all.
void fill(const SmoothMesh& smooth, const PatchMesh& mesh, const std::vector<Rgb>& radiosity, std::vector<Rgb>& value,
          std::vector<double>& weight) {
  for (const auto& f : smooth.filled) {
    if (weight[f.vertex] > 0) continue;
    for (const std::uint32_t from : f.from) {
      if (!(weight[from] > 0)) continue;
      for (std::size_t c = 0; c < 3; ++c) value[f.vertex][c] += value[from][c];
      weight[f.vertex] += 1;
    }
    for (double& c : value[f.vertex]) c = weight[f.vertex] > 0 ? c / weight[f.vertex] : 0;
  }
  if (smooth.walls.size() == 0) return;
  std::vector<double> area(smooth.size(), 0);
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const Rgb& b = radiosity[i];
    if (smooth.walls.cut(i) == nullptr || !std::isfinite(b[0] + b[1] + b[2])) continue;
    for (const std::uint32_t s : smooth.corners[i]) {
      if (weight[s] > 0) continue;
      for (std::size_t c = 0; c < 3; ++c) value[s][c] += mesh.area[i] * b[c];
      area[s] += mesh.area[i];
    }
  }
  for (std::size_t s = 0; s < smooth.size(); ++s) {
    if (area[s] > 0)
      for (double& c : value[s]) c /= area[s];
  }
}

std::vector<Rgb> smooth_radiosities(const SmoothMesh& smooth, const PatchMesh& mesh,
                                    const std::vector<Rgb>& radiosity) {
  if (radiosity.size() != mesh.size()) {
    throw Error(ErrorKind::internal,
                fmt::format("output: {} radiosities for {} patches", radiosity.size(), mesh.size()));
  }
  std::vector<Rgb> value(smooth.size(), Rgb{});
  std::vector<double> weight(smooth.size(), 0);
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const Rgb& b = radiosity[i];
    if (!std::isfinite(b[0]) || !std::isfinite(b[1]) || !std::isfinite(b[2])) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t s = smooth.corners[i][k];
      const double w = weight_of(mesh, smooth.walls, static_cast<std::uint32_t>(i), k);
      for (std::size_t c = 0; c < 3; ++c) value[s][c] += w * b[c];
      weight[s] += w;
    }
  }
  for (std::size_t s = 0; s < smooth.size(); ++s) {
    for (double& c : value[s]) c = weight[s] > 0 ? c / weight[s] : 0;
  }
  fill(smooth, mesh, radiosity, value, weight);
  for (const auto& h : smooth.hanging) {
    for (std::size_t c = 0; c < 3; ++c) value[h.vertex][c] = 0.5 * (value[h.ends[0]][c] + value[h.ends[1]][c]);
  }
  return value;
}

std::vector<std::array<Rgb, 3>> corner_radiosities(const PatchMesh& mesh, const std::vector<Rgb>& radiosity,
                                                   double crease) {
  const SmoothMesh smooth = smooth_mesh(mesh, crease);
  const std::vector<Rgb> value = smooth_radiosities(smooth, mesh, radiosity);
  std::vector<std::array<Rgb, 3>> corners(mesh.size());
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) corners[i][c] = value[smooth.corners[i][c]];
  }
  return corners;
}

void check_solution(const Solution& solution) {
  if (solution.mesh == nullptr) throw Error(ErrorKind::internal, "output: a solution without a mesh");
  const PatchMesh& mesh = *solution.mesh;
  const auto demand = [](std::string_view what, std::size_t has, std::size_t needs) {
    if (has != needs) throw Error(ErrorKind::internal, fmt::format("output: {} {} instead of {}", has, what, needs));
  };
  demand("radiosities", solution.radiosity.size(), mesh.size());
  demand("row sums", solution.row_sum.size(), mesh.size());
  demand("groups of surfaces", solution.grouping.of_surface.size(), mesh.surfaces.size());
  for (const std::uint32_t g : solution.grouping.of_surface) {
    if (g >= solution.grouping.names.size()) throw Error(ErrorKind::internal, "output: a group without a name");
  }
}

}  // namespace interflect
