#pragma once

#include <cstdint>

#include "interflect/base/tile.h"

// The argument blocks of the kernels: plain structs of 32-bit values, the same bytes in every language.
// kernels/README.md gives each kernel's reference loop and buffers.

namespace interflect {

/// matvec: y[c * vector_stride + first + r] = Σ_j f[r * row_stride + j] * x[c * vector_stride + j] for r < rows, j < n.
/// Buffers: f (one panel), x, y. Macro COLUMNS: how many c.
struct MatvecArguments {
  std::uint32_t n = 0;              ///< columns of F
  std::uint32_t first = 0;          ///< the panel's first row
  std::uint32_t rows = 0;           ///< rows in the panel
  std::uint32_t row_stride = 0;     ///< elements from one row of F to the next, a multiple of 16
  std::uint32_t vector_stride = 0;  ///< elements from one column of x or y to the next, a multiple of 16
};

/// Rows of a panel for one work-group of matvec_exact and close_rows, which take MatvecArguments as well.
///   matvec_exact: y as hi + lo; hi as y of matvec, lo COLUMNS * vector_stride floats behind it.
///   close_rows: f[r, j] *= factor[first + r] * d[j] in place; of the row, at of_rows[k * vector_stride + first + r]: k
///   = 0, 1 the least and largest d[j] with f[r, j] != 0, k = 2 how many there are. Buffers: f, d, factor, of_rows.
inline constexpr std::uint32_t panel_group = 4;

// The 16-bit formats. Elements are fp16 (halves); x comes scaled, from the kernel `scale`, with zeros behind its n
// elements; a tile is 8 rows x 16 columns, row-major, and begins at multiples of these.

/// tiles16: y[c, i] = scale[i] * Σ over the tiles t of strip s of Σ_l tile[t][q][l] * x[c, 16 * column[t] + l] for the
/// rows i = first + 8 s + q < n of the panel's strips. index: tile_begin[strips + 1], column[tiles].
struct TileArguments {
  std::uint32_t n = 0;              ///< rows and columns of F
  std::uint32_t first = 0;          ///< the panel's first row, a multiple of 8
  std::uint32_t strips = 0;         ///< strips of 8 rows in the panel
  std::uint32_t tiles = 0;          ///< in the panel
  std::uint32_t vector_stride = 0;  ///< elements from one column of x or y to the next, a multiple of 16
};

/// sym16: the panel's blocks (I, J), I <= J, of BLOCK x BLOCK elements, each used for its rows and for its columns:
/// partial[I, J] = block * x_J and partial[J, I] = block^T * x_I, or their sum where I = J.
/// index: {I, J, first strip, end of strips}[blocks], the strip's number in its block[strips], tile_begin[strips + 1],
/// the tile column in its block[tiles].
struct SymmetricArguments {
  std::uint32_t blocks = 0;         ///< in the panel, one for each work-group
  std::uint32_t strips = 0;         ///< in the panel
  std::uint32_t tiles = 0;          ///< in the panel
  std::uint32_t block_rows = 0;     ///< blocks along a side of F
  std::uint32_t vector_stride = 0;  ///< of x, a multiple of 16
};

/// The vector kernels (dot, axpby, bounce, cg_*, bicgstab_*): work item k = column * blocks + block handles elements
/// [block * reduction_block, ...) of its column; work-group g does items [g * blocks_per_group, ...).
struct VectorArguments {
  std::uint32_t n = 0;                 ///< elements in a column
  std::uint32_t vector_stride = 0;     ///< elements from one column to the next, a multiple of 16
  std::uint32_t columns = 0;           ///< how many columns
  std::uint32_t blocks = 0;            ///< ceil(n / reduction_block)
  std::uint32_t blocks_per_group = 0;  ///< the launch's shape; no result depends on it
  /// bounce: 1 adds the bounce to x. dot, reduce: the set of sums. sym16_fold: rows of a block.
  std::uint32_t option = 0;
  std::uint32_t slot = 0;  ///< reduce: the slot that takes the sum. sym16_fold: blocks along a side
};

/// Elements that one partial sum covers.
inline constexpr std::uint32_t reduction_block = 1024;

/// The sums buffer: float[scalar_slots][columns], then float[sum_sets][columns][blocks], the partial sums.
inline constexpr std::uint32_t scalar_slots = 8;
inline constexpr std::uint32_t sum_sets = 6;

/// Elements of a sums buffer.
[[nodiscard]] constexpr std::uint64_t sums_size(std::uint64_t columns, std::uint64_t blocks) {
  return columns * (scalar_slots + sum_sets * blocks);
}

/// Scalars per column that live on the device. The kernels' contract says who reads and who writes which.
namespace slot {
inline constexpr std::uint32_t target = 0;  ///< a column whose (r, r) is not above it is left as it is
inline constexpr std::uint32_t alpha = 1;
inline constexpr std::uint32_t cg_gamma_old = 2, cg_gamma = 3, cg_beta = 4, cg_shift = 5;
inline constexpr std::uint32_t bicgstab_rho = 2, bicgstab_rho_used = 3, bicgstab_shadow = 4, bicgstab_restarts = 5;
inline constexpr std::uint32_t axpby_a = 6, axpby_b = 7;
}  // namespace slot

/// Sets of partial sums.
namespace sum {
inline constexpr std::uint32_t rr = 0;                                  ///< (r, r)
inline constexpr std::uint32_t gamma = 1, delta = 2;                    ///< CG: (d r, r), (d r, w)
inline constexpr std::uint32_t xw = 1, ww = 2, zx = 3, zw = 4, xx = 5;  ///< BiCGSTAB's product
}  // namespace sum

/// read and copy, which measure a device's bandwidth: over `lines` cache lines of 16 floats each.
struct StreamArguments {
  std::uint32_t lines = 0;
};

/// shadow_rays: hidden[i] = 1 where a triangle lies on ray i, else 0. Buffers: a hierarchy's nodes and leaves
/// (hierarchy.h), rays of 8 floats (origin, near, direction, far), hidden.
struct ShadowRayArguments {
  std::uint32_t rays = 0;
  std::uint32_t nodes = 0;   ///< of the hierarchy, at least 1
  std::uint32_t leaves = 0;  ///< of the hierarchy, at least 1
};

/// The assembly of S by tiles (tile_kinds ... tile_store): one block for all its kernels. Buffers: patches, tiles,
/// work, extra, and for tile_rays a hierarchy's nodes and leaves (hierarchy.h), for tile_store a panel.
struct AssemblyArguments {
  std::uint32_t n = 0;      ///< patches; the table is padded to whole blocks of 32
  std::uint32_t tiles = 0;  ///< in the batch
  std::uint32_t first = 0;  ///< the launch does items [first, first + items)
  std::uint32_t items = 0;
  /// tile_special: the list. tile_rays: 0 the pilot's first chunks, 1 the list. tile_shares: 0 pilot, 1 all rays.
  std::uint32_t option = 0;
  std::uint32_t chunks = 0;                         ///< that `extra` has room for
  std::uint32_t cuts = 0;                           ///< likewise
  float pilot_per_factor = 0, rays_per_factor = 0;  ///< from here on RayBudget
  std::uint32_t most_in_pilot = 0, fewest = 0, most = 0;
  float split_from = 0, three2 = 0, six2 = 0;  ///< the ratios squared
  float three_error2 = 0, six_error2 = 0;      ///< the errors squared
  float lift = 0;                              ///< of the rays' ends off their patches
  std::uint32_t panel_first = 0, panel_rows = 0, panel_stride = 0;
};

/// Sizes of the assembly's buffers, in words of 32 bits; kernels/shared/tile_layout.h has the same.
namespace assembly {
inline constexpr std::uint32_t block = 32, tile_pairs = block * block;
inline constexpr std::uint32_t patch_words = 32, tile_words = 4;
inline constexpr std::uint32_t counters = 16, sections = 9;
inline constexpr std::uint32_t chunk_rays = 8, chunk_words = 7, cut_pieces = 64, cut_words = 196;
inline constexpr std::uint32_t traced_bit = 0x80000000U;
inline constexpr std::uint32_t most_pilot = 8191;  ///< what most_in_pilot may be: a pair's state has 13 bits for it
/// Places of the counters: three lists of pairs, two of chunks, cuts, facts.
inline constexpr std::uint32_t lists = 0, chunks = 3, cuts = 5, considered = 6, analytic = 7, rays = 8;
[[nodiscard]] constexpr std::uint64_t work_words(std::uint64_t tiles) {
  return counters + tiles * (sections * tile_pairs + block);
}
[[nodiscard]] constexpr std::uint64_t extra_words(std::uint64_t chunk_room, std::uint64_t cut_room) {
  return chunk_room * chunk_words + cut_room * cut_words;
}
}  // namespace assembly

}  // namespace interflect
