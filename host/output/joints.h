#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// A corner of a patch, or a vertex of its neighbours that lies on one of its edges.
struct Joint {
  std::uint32_t vertex = 0;             ///< into PatchMesh::vertices
  std::array<std::uint32_t, 2> ends{};  ///< 0 to 2: the patch's corners between which it lies; equal for a corner
  double share = 0;                     ///< how far from the first to the second, 0 to 1
};

/// Cuts patches so that no vertex lies on another triangle's edge: where patches of different size meet, programs that
/// draw triangle by triangle would show gaps of single pixels.
class JointCutter {
 public:
  explicit JointCutter(const PatchMesh& mesh);

  /// The patch as triangles with its winding; itself where no neighbour is finer. Vertices count that the patches'
  /// edges lead to, from one end of the patch's edge to the other; none is added at one with more than 1,000 edges.
  [[nodiscard]] std::vector<std::array<Joint, 3>> cut(std::uint32_t patch) const;

 private:
  [[nodiscard]] std::vector<Joint> on_edge(std::uint32_t patch, std::uint32_t from, std::uint32_t to) const;

  const PatchMesh& mesh_;
  double near_ = 0;                  ///< how far off the edge a vertex may lie
  std::vector<std::size_t> start_;   ///< per vertex: where its part of next_ begins
  std::vector<std::uint32_t> next_;  ///< the vertices to which edges of patches lead
};

}  // namespace interflect
