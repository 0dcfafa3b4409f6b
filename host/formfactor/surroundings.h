#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "interflect/formfactor/mesh_edges.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/visibility.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// What cosine-distributed rays from points of one patch meet: shares of the rays unless said otherwise.
struct Around {
  double escape = 0;          ///< leave the scene
  double back = 0;            ///< end on the back of a surface
  double back_of_turned = 0;  ///< end on the back of a patch that MeshEdges::turned marks
  double inside = 0;          ///< share of the points that see next to nothing but backs and, maybe, the outside
  double near = 0;            ///< end nearer to the patch than its own radius
  std::optional<std::uint32_t> back_surface;  ///< whose backs most rays meet: index into PatchMesh::surfaces
  std::optional<std::uint32_t> edge_surface;  ///< whose open edges the escaping rays pass nearest
};

/// Looks around from patches closely, where a form factor's row is to be explained. Has a hierarchy of its own over the
/// patches, so that a ray's end names a patch.
class Surroundings {
 public:
  Surroundings(const PatchMesh& mesh, const PatchTable& patches);

  /// With points x directions rays, the same at every call.
  [[nodiscard]] Around look(std::uint32_t patch) const;
  [[nodiscard]] const MeshEdges& edges() const { return edges_; }

  static constexpr std::uint32_t points = 32, directions = 64;

 private:
  struct Shape {
    std::vector<Vec3> vertices;  ///< in the table's coordinates
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<std::uint32_t> patch;  ///< per triangle: of its front
    std::vector<bool> two_sided;
  };
  static Shape shape(const PatchMesh& mesh, const PatchTable& patches);
  [[nodiscard]] std::optional<std::uint32_t> edge_near(Vec3 from, Vec3 direction) const;

  const PatchMesh& mesh_;
  const PatchTable& patches_;
  Shape shape_;
  Visibility visibility_;
  MeshEdges edges_;
};

}  // namespace interflect
