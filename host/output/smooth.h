#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "interflect/output/output.h"
#include "interflect/output/walls.h"

namespace interflect {

/// The vertices of a mesh as shading needs them: a mesh vertex counts once for each surface that meets there (see
/// corner_radiosities()). Depends on geometry and materials only, so that many radiosities can be smoothed with it.
struct SmoothMesh {
  std::vector<std::array<std::uint32_t, 3>> corners;  ///< per patch: its three smooth vertices
  std::vector<std::uint32_t> vertex;                  ///< per smooth vertex: index into PatchMesh::vertices
  std::vector<Vec3> normal;                           ///< per smooth vertex: area-weighted mean, unit length
  /// A smooth vertex that hangs in the middle of a longer edge, in the order in which to apply them.
  struct Hanging {
    std::uint32_t vertex = 0;
    std::array<std::uint32_t, 2> ends{};
  };
  std::vector<Hanging> hanging;
  /// What stands on the patches: light does not mix across it.
  Walls walls;
  /// A smooth vertex all of whose patches go on under a wall: it takes the mean of these others, in this order.
  struct Filled {
    std::uint32_t vertex = 0;
    std::vector<std::uint32_t> from;
  };
  std::vector<Filled> filled;

  [[nodiscard]] std::size_t size() const { return vertex.size(); }
};

/// The largest angle, in radians, between patches that are shaded as one surface.
inline constexpr double smooth_crease = 0.8;

/// Finds the surfaces around every vertex. O(N log N) but for vertices with more than 64 patches around them, where
/// only patches that share a whole edge are connected. With `walls` a surface also ends at walls that share no vertex
/// with it.
[[nodiscard]] SmoothMesh smooth_mesh(const PatchMesh& mesh, double crease = smooth_crease, bool walls = true);

/// The radiosity at each smooth vertex: area-weighted mean over its patches, hanging vertices interpolated. A patch
/// that goes on under a wall takes part only at corners whose part is nearly the whole of it.
[[nodiscard]] std::vector<Rgb> smooth_radiosities(const SmoothMesh& smooth, const PatchMesh& mesh,
                                                  const std::vector<Rgb>& radiosity);

/// Throws an internal Error unless the solution has a mesh, a radiosity per patch and a group per surface.
void check_solution(const Solution& solution);

}  // namespace interflect
