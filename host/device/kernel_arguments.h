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
///   close_rows: f[r, j] *= factor[first + r] * d[j] in place; of the row, at of_rows[k * vector_stride + first + r]: k = 0,
///   1 the least and largest d[j] with f[r, j] != 0, k = 2 how many there are. Buffers: f, d, factor, of_rows.
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

}  // namespace interflect
