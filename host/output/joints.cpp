#include "interflect/output/joints.h"

#include <algorithm>
#include <numeric>
#include <span>

namespace interflect {

namespace {

constexpr std::size_t most_edges = 1000;

using Corners = std::array<Joint, 3>;
using Between = std::array<std::vector<Joint>, 3>;  ///< per edge, from corner k to corner k + 1

/// Halves the triangle at the middle one of the joints on an edge until none is left.
void divide(const Corners& corners, const Between& between, std::vector<Corners>& out) {
  for (std::size_t k = 0; k < 3; ++k) {
    const std::vector<Joint>& edge = between[k];
    if (edge.empty()) continue;
    const std::size_t middle = edge.size() / 2, l = (k + 1) % 3, m = (k + 2) % 3;
    const auto at = edge.begin() + static_cast<std::ptrdiff_t>(middle);
    divide({corners[k], *at, corners[m]}, {std::vector<Joint>(edge.begin(), at), {}, between[m]}, out);
    divide({*at, corners[l], corners[m]}, {std::vector<Joint>(at + 1, edge.end()), between[l], {}}, out);
    return;
  }
  out.push_back(corners);
}

}  // namespace

JointCutter::JointCutter(const PatchMesh& mesh) : mesh_(mesh), start_(mesh.vertices.size() + 1, 0) {
  Vec3 low = mesh.vertices.front(), high = low;
  for (const Vec3 v : mesh.vertices) low = min(low, v), high = max(high, v);
  near_ = 2e-6 * length(high - low);
  for (const auto& corners : mesh.corners) {
    for (const std::uint32_t v : corners) start_[v + 1] += 2;
  }
  std::partial_sum(start_.begin(), start_.end(), start_.begin());
  next_.resize(start_.back());
  std::vector<std::size_t> free(start_.begin(), start_.end() - 1);
  for (const auto& c : mesh.corners) {
    for (std::size_t k = 0; k < 3; ++k) {
      next_[free[c[k]]++] = c[(k + 1) % 3];
      next_[free[c[k]]++] = c[(k + 2) % 3];
    }
  }
}

std::vector<Joint> JointCutter::on_edge(std::uint32_t patch, std::uint32_t from, std::uint32_t to) const {
  const std::uint32_t a = mesh_.corners[patch][from], b = mesh_.corners[patch][to];
  const Vec3 start = mesh_.vertices[a], along = mesh_.vertices[b] - start;
  const double size = length(along), tolerance = std::min(near_, 1e-3 * size);
  std::vector<Joint> joints;
  double reached = 0;
  for (std::uint32_t v = a; v != b;) {
    const auto next = std::span(next_).subspan(start_[v], start_[v + 1] - start_[v]);
    if (next.size() > most_edges) return {};
    Joint nearest{b, {from, to}, 1};
    for (const std::uint32_t n : next) {
      const Vec3 off = mesh_.vertices[n] - start;
      const double share = dot(off, along) / (size * size);
      if (!(share > reached && share < nearest.share) || n == b) continue;
      if (length(off - along * share) <= tolerance) nearest.vertex = n, nearest.share = share;
    }
    v = nearest.vertex;
    reached = nearest.share;
    if (v != b) joints.push_back(nearest);
  }
  return joints;
}

std::vector<std::array<Joint, 3>> JointCutter::cut(std::uint32_t patch) const {
  Corners corners{};
  Between between;
  for (std::uint32_t k = 0; k < 3; ++k) {
    corners[k] = {mesh_.corners[patch][k], {k, k}, 0};
    between[k] = on_edge(patch, k, (k + 1) % 3);
  }
  std::vector<Corners> out;
  divide(corners, between, out);
  return out;
}

}  // namespace interflect
