#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect {

/// The solids of rrv's scene format, about its own unit sizes and with y upwards.
enum class Primitive {
  cuboid,  ///< the cube [-½, ½]³
  barrel,  ///< the cylinder of radius ½ about the y axis, -½ <= y <= ½, with both lids
  globe,   ///< the sphere of radius ½ about the origin
  teapot,  ///< Newell's teapot in its published size, standing on y = 0 with its spout towards +x
};

/// A triangle mesh with shared vertices, closed where the solid is closed; fronts (counter-clockwise) point outwards.
struct SurfaceMesh {
  std::vector<Vec3> positions;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// The number of segments that a primitive is cut into: along an edge of the cuboid, around the barrel, around the
/// globe (half as many from pole to pole), along an edge of each of the teapot's Bézier patches.
struct DivisionRange {
  int least, usual, most;
};
/// Usual is what rrv always takes: 1, 20, 20 (12, 80 and 360 triangles); 8 for the teapot, near rrv's 3,752 triangles.
[[nodiscard]] DivisionRange division_range(Primitive primitive);

/// The number of triangles of make_primitive(), without making them: 12 n², 4 n, 2 n (b - 1) with b = max(2, n / 2)
/// bands, 64 n² - 8 n.
[[nodiscard]] std::uint64_t primitive_triangles(Primitive primitive, int division);

/// The primitive's mesh. Vertices lie on the exact surface, so curved solids are inscribed: the barrel is a prism of
/// area n (r² sin(2π/n) + 2 r h sin(π/n)). Throws an internal Error when the division is out of range.
[[nodiscard]] SurfaceMesh make_primitive(Primitive primitive, int division);

/// Newell's teapot (M. Newell 1975; the published set of 32 bicubic Bézier patches with 306 control points), each patch
/// as n x n quadrilaterals of two triangles. Neighbouring patches are sampled at the same parameters and share their
/// vertices; triangles that collapse at the two poles are left out, and the poles are single points (the published
/// control points leave a loop of 0.002 at the top). The published coordinates have z upwards; here (x, y, z) is their
/// (x, z, -y). Bounding box: -3 <= x <= 3.434, 0 <= y <= 3.15, -2 <= z <= 2. The teapot is not closed: handle and spout
/// end inside the body, the lid lies in the rim without touching it.
[[nodiscard]] SurfaceMesh make_teapot(int division);

}  // namespace interflect
