#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/scene/scene.h"

namespace interflect {

/// The scene cut into patches: flat triangles with constant reflectance, emittance and radiosity. One-sided: the front,
/// where the normal points, emits and receives; the back blocks. A two-sided triangle gives two patches that share
/// their vertices with opposite winding. Vertices are welded: patches that touch share an index.
struct PatchMesh {
  std::vector<Vec3> vertices;
  // One entry per patch in each of these.
  std::vector<std::array<std::uint32_t, 3>> corners;  ///< into vertices, counter-clockwise from the front
  std::vector<double> area;                           ///< A_i
  std::vector<Vec3> centroid;
  std::vector<Vec3> normal;            ///< unit length
  std::vector<Rgb> reflectance;        ///< ρ_i
  std::vector<Rgb> emittance;          ///< E_i
  std::vector<std::uint32_t> surface;  ///< index into surfaces
  std::vector<std::uint32_t>
      source;                     ///< index into Scene::triangles: patches of one source are coplanar and consecutive
  std::vector<Surface> surfaces;  ///< copied from the scene

  [[nodiscard]] std::size_t size() const { return corners.size(); }
  [[nodiscard]] std::array<Vec3, 3> triangle(std::size_t i) const {
    return {vertices[corners[i][0]], vertices[corners[i][1]], vertices[corners[i][2]]};
  }
};

struct SubdivideOptions {
  double divide = 0;  ///< rrv's rule: split at the edge midpoints into four until the area is <= this; 0: do not split
  std::uint64_t patches = 0;  ///< instead of divide: choose the area whose count comes nearest to this
  bool two_sided = false;     ///< a patch on each side of every triangle, whatever its material says
  std::uint64_t max_patches = std::uint64_t{1}
                              << 24;  ///< more than this is a limit Error, before anything is allocated
};

/// The number of patches that subdivide() would make at this area. Counts without making them.
[[nodiscard]] std::uint64_t count_patches(const Scene& scene, double divide, bool two_sided = false);

/// The area whose patch count comes nearest to `patches` (the smaller count on a tie).
[[nodiscard]] double choose_divide(const Scene& scene, std::uint64_t patches, bool two_sided = false);

/// Cuts the scene into patches. Degenerate triangles (area 0 to rounding) are left out. Patch order: by source
/// triangle, then by the hierarchy of its subdivision, so that neighbours in index are neighbours in space. A two-sided
/// source triangle gives first its n front patches, then their n back patches in the same order: the back of patch i is
/// i + n. Vertices closer than 1e-6 of the scene's diagonal and 1e-3 of the patch's altitude are welded. Textured
/// materials give each patch the mean of the texture over it, times the constant. Throws a limit Error for more than
/// max_patches (and 2^30), an input Error when nothing is left, a usage Error for a negative or non-finite area and for
/// a scene with an index out of range.
[[nodiscard]] PatchMesh subdivide(const Scene& scene, const SubdivideOptions& options);

/// One finding of the input check.
struct Finding {
  enum class Severity { warning, error };
  Severity severity = Severity::warning;
  std::string what;  ///< e.g. "degenerate triangles (dropped)"
  std::uint64_t count = 0;
  std::vector<std::string> first;  ///< the first offenders: "line 12 (object 'table', 3 of 40)" or the like
  /// "WHAT: COUNT, first: A; B; C" as one line.
  [[nodiscard]] std::string line() const;
};

/// What can be said of a scene before any form factor is known: degenerate and duplicate triangles, faces whose normals
/// disagree with a closed neighbourhood (an edge that two neighbours run through in the same direction, in a component
/// that has no boundary edge), reflectances outside [0, 1] (above 1 or NaN: error), no emitter, open edges.
/// Reports the findings; throws nothing.
[[nodiscard]] std::vector<Finding> check_scene(const Scene& scene, bool two_sided = false);

}  // namespace interflect
