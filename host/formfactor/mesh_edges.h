#pragma once

#include <cstdint>
#include <vector>

#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// What the edges of a mesh say of it.
struct MeshEdges {
  /// An edge that one patch alone uses.
  struct Open {
    std::uint32_t low, high;  ///< its ends, low < high: indices into the mesh's vertices
    std::uint32_t patch;
  };
  std::vector<Open> open;  ///< by ends
  /// Per patch: whether its winding disagrees with the greater part of the piece of surface that it belongs to. A piece
  /// is what hangs together by edges that two patches share; neighbours that agree run through such an edge in opposite
  /// directions. Of a piece whose halves are equal none is marked.
  std::vector<bool> turned;
};

/// Takes time of the order of n log n.
[[nodiscard]] MeshEdges edges_of(const PatchMesh& mesh);

}  // namespace interflect
