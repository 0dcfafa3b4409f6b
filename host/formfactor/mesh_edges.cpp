#include "interflect/formfactor/mesh_edges.h"

#include <algorithm>
#include <array>
#include <limits>
#include <tuple>

namespace interflect {

namespace {

/// One patch's use of an edge.
struct Use {
  std::uint32_t low, high, patch;
  bool rising;  ///< the patch runs through it from low to high
  [[nodiscard]] bool same_edge(const Use& other) const { return low == other.low && high == other.high; }
};

std::vector<Use> uses_of(const PatchMesh& mesh) {
  std::vector<Use> uses;
  uses.reserve(3 * mesh.size());
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh.corners[i][k], b = mesh.corners[i][(k + 1) % 3];
      uses.push_back({std::min(a, b), std::max(a, b), i, a < b});
    }
  }
  std::sort(uses.begin(), uses.end(), [](const Use& a, const Use& b) {
    return std::tie(a.low, a.high, a.patch) < std::tie(b.low, b.high, b.patch);
  });
  return uses;
}

/// A patch has three edges, and at most one neighbour over each.
struct Neighbour {
  static constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t patch = none;
  bool against = false;
};
using Neighbours = std::array<Neighbour, 3>;

void link(Neighbours& of, std::uint32_t patch, bool against) {
  const auto free = std::find_if(of.begin(), of.end(), [](const Neighbour& n) { return n.patch == Neighbour::none; });
  if (free != of.end()) *free = {patch, against};
}

std::vector<bool> turned(const std::vector<Neighbours>& links) {
  std::vector<bool> out(links.size());
  std::vector<signed char> side(links.size(), -1);  // -1: not reached yet
  for (std::uint32_t start = 0; start < links.size(); ++start) {
    if (side[start] >= 0) continue;
    std::vector<std::uint32_t> piece{start};
    side[start] = 0;
    std::size_t other_side = 0;
    for (std::size_t i = 0; i < piece.size(); ++i) {
      const signed char here = side[piece[i]];
      other_side += here == 1 ? 1U : 0U;
      for (const Neighbour& next : links[piece[i]]) {
        if (next.patch == Neighbour::none || side[next.patch] >= 0) continue;
        side[next.patch] = next.against ? static_cast<signed char>(1 - here) : here;
        piece.push_back(next.patch);
      }
    }
    if (2 * other_side == piece.size()) continue;
    const signed char minority = 2 * other_side < piece.size() ? 1 : 0;
    for (const std::uint32_t i : piece) out[i] = side[i] == minority;
  }
  return out;
}

}  // namespace

MeshEdges edges_of(const PatchMesh& mesh) {
  MeshEdges out;
  std::vector<Neighbours> links(mesh.size());
  const std::vector<Use> uses = uses_of(mesh);
  for (std::size_t i = 0, end = 0; i < uses.size(); i = end) {
    end = i + 1;
    while (end < uses.size() && uses[end].same_edge(uses[i])) ++end;
    const Use &a = uses[i], &b = uses[end - 1];
    if (end - i == 1) {
      out.open.push_back({a.low, a.high, a.patch});
    } else if (end - i == 2) {
      link(links[a.patch], b.patch, a.rising == b.rising);
      link(links[b.patch], a.patch, a.rising == b.rising);
    }
  }
  out.turned = turned(links);
  return out;
}

}  // namespace interflect
