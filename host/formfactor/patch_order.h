#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "interflect/base/tile.h"
#include "interflect/base/vec3.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/scene/patch_mesh.h"

/// The order of the patches in which the tiled formats store F: such that as many tiles as possible hold only zeros.
namespace interflect {

/// What the tiled formats would store.
struct TileCount {
  std::uint64_t stored = 0, tiles = 0;                    ///< with a non-zero element, and all
  std::uint64_t triangle_stored = 0, triangle_tiles = 0;  ///< of the tiles with a place where row <= column
  std::uint64_t nonzero_elements = 0;                     ///< of the whole matrix

  [[nodiscard]] double stored_fraction() const;           ///< stored / tiles, 0 without tiles
  [[nodiscard]] double triangle_stored_fraction() const;  ///< triangle_stored / triangle_tiles, 0 without tiles
};

/// Counts the tiles of F with rows and columns in this order. A tile on the triangle's edge counts with all its
/// elements. Throws an internal Error when the order is not a permutation of the patches.
[[nodiscard]] TileCount count_tiles(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order);

/// An order with few stored tiles, from the zeros of F alone: order[k] is the patch that comes at place k. Patches are
/// joined to pairs, fours, eights and sixteens that see the same others; they look for partners among those near them
/// in index. Never stores noticeably more tiles than the order of the indices. The zeros are taken to lie
/// symmetrically. The same input gives the same order, whatever the number of threads. Takes O(N²) time with a small
/// factor (a pass over F and 1,000 N comparisons of rows of up to 2,560 bits) and N · 320 bytes.
[[nodiscard]] std::vector<std::uint32_t> patch_order(const FormFactorMatrix& form_factors);

/// The same; partners are looked for among those near in space and direction instead where these stand in no useful
/// order in the file. Throws an internal Error when mesh and matrix differ in size.
[[nodiscard]] std::vector<std::uint32_t> patch_order(const PatchMesh& mesh, const FormFactorMatrix& form_factors);

/// The patches along a Morton curve through space and directions: neighbours in it are near each other and look the
/// same way. `normal` has unit length and as many entries as `centre`.
[[nodiscard]] std::vector<std::uint32_t> spatial_order(std::span<const Vec3> centre, std::span<const Vec3> normal);

}  // namespace interflect
