#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "interflect/base/half.h"
#include "interflect/base/memory.h"
#include "interflect/base/tile.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/storage.h"

namespace interflect {

/// F in 16 bits. What is stored is
///
///     H_ij = fp16(2^15 sqrt(F_ij F_ji)),   sqrt(F_ij F_ji) = S_ij / sqrt(A_i A_j) = F_ij s_i / s_j,   s_i = sqrt(A_i /
///     mean A)
///
/// and F_ij = H_ij s_j / (2^15 s_i): y = F x is y_i = (2^-15 / s_i) Σ_j H_ij (s_j x_j). The scaling is by reciprocity
/// the one that makes the matrix symmetric. No element can overflow, since F_ij ≤ 1 gives H_ij ≤ 32,768 (65,504 is the
/// largest half); elements down to 2^-29 keep eleven bits, and what is lost below 2^-40 adds up to less than N 2^-40 in
/// a row. The same s scales vectors, so that no kernel handles more than N floats of it.
///
/// Places: place k of a vector or row is patch order()[k]; tiles and kernels know places only.
/// A tile is 8 rows x 16 columns, row-major, and begins at multiples of these. Units, which panels are made of: dense16
/// and tiled16: a strip of 8 rows, its tiles in the order of their columns (dense16: all tiles). sym16: a block of
/// block() rows x block() columns on or above the diagonal, block row by block row; in it strips from above, in those
/// tiles in the order of their columns. Empty tiles are not stored. sym16 has 0 below the diagonal and half of H_ii on
/// it, so that each element is used once for its row and once for its column, without exceptions.
class PackedMatrix {
 public:
  static constexpr float element_scale = 32768;  ///< the 2^15

  struct Options {
    std::vector<std::uint32_t> order = {};  ///< a permutation of the patches; empty: as they are
    std::uint32_t block = 0;                ///< sym16: a multiple of 16; 0: default_block()
    std::uint64_t max_panel_bytes = FormFactorMatrix::default_panel_bytes();
  };
  /// From the fp32 matrix and the patches' areas. Of a matrix of some rows only (FormFactorMatrix::rows_only, beginning
  /// at a multiple of 8) dense16 and tiled16 in the patches' own order hold these rows; in other places y is 0. Throws
  /// a usage Error for dense32, areas or an order of another length, an order that is no permutation, a block that is
  /// no multiple of 16; an input Error for an area that is not positive, or so far from the mean that fp32 cannot scale
  /// by it; a limit Error when packing needs more memory than may be used, or the system refuses it.
  PackedMatrix(const FormFactorMatrix& form_factors, std::span<const double> area, Storage storage, Options options);
  PackedMatrix(const FormFactorMatrix& form_factors, std::span<const double> area, Storage storage)
      : PackedMatrix(form_factors, area, storage, Options{}) {}

  [[nodiscard]] std::uint32_t size() const { return n_; }
  [[nodiscard]] Storage storage() const { return storage_; }
  [[nodiscard]] std::uint32_t stride() const { return stride_; }  ///< n rounded up to a multiple of 16
  [[nodiscard]] std::span<const std::uint32_t> order() const { return order_; }
  /// By place, stride() floats each, padding 0: what a vector is multiplied with on its way in (s), and what comes out
  /// (2^-15 / s).
  [[nodiscard]] std::span<const float> scale_in() const { return scale_in_; }
  [[nodiscard]] std::span<const float> scale_out() const { return scale_out_; }
  [[nodiscard]] std::uint32_t block() const { return block_; }            ///< sym16: rows of a block
  [[nodiscard]] std::uint32_t block_rows() const { return block_rows_; }  ///< sym16: ceil(n / block)

  /// Of elements and of the index, as panels hold them.
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  [[nodiscard]] std::uint64_t stored_elements() const { return unit_begin_.empty() ? 0 : unit_begin_.back(); }
  /// Share of the n² elements of H (both triangles) that are not zero.
  [[nodiscard]] double nonzero_fraction() const { return nonzero_fraction_; }

  /// visit(row, columns, tiles) for every strip of a unit in the order in which they lie: place of its first row, the
  /// tile column (column / 16) of each of its tiles, and the tiles' halves one after the other.
  template <class Visit>
  void for_each_strip(std::uint32_t unit, Visit visit) const {
    const Half* tiles = elements(unit);
    for (std::uint32_t s = unit_strips_[unit]; s < unit_strips_[unit + 1]; ++s) {
      const std::uint64_t first = strips_[s].first_tile, count = strips_[s + 1].first_tile - first;
      visit(strips_[s].row * tile_rows, std::span(columns_).subspan(first, count), tiles);
      tiles += count * tile_elements;
    }
  }
  /// sym16: the block of a unit, as its row and its column of blocks.
  struct BlockPlace {
    std::uint32_t row = 0, column = 0;
  };
  [[nodiscard]] BlockPlace block_of(std::uint32_t unit) const;
  [[nodiscard]] std::uint32_t units() const { return static_cast<std::uint32_t>(unit_begin_.size() - 1); }

  /// A run of units with its elements and, for tiles, its index: u32s, offsets counted from its own first unit.
  ///   dense16, tiled16: tile_begin[units + 1], then the tile column (column / 16) of each tile
  ///   sym16: 4 for each block: block row, block column, first strip, end of strips; then for each strip that has
  ///            tiles its number in the block, then tile_begin[strips + 1], then the tile column in the block of each
  struct Panel {
    std::uint32_t first = 0, units = 0;
    std::uint32_t strips = 0, tiles = 0;       ///< sym16, tiled16
    std::span<const std::byte> elements;       ///< halves
    std::shared_ptr<const PageBuffer> shared;  ///< the elements' memory, alone or as a part; else null
    std::vector<std::uint32_t> index;
  };
  /// Cuts the matrix into panels of at most max_bytes of elements and max_units units. Throws a limit Error where a
  /// single unit is larger.
  [[nodiscard]] std::vector<Panel> panels(std::uint64_t max_bytes, std::uint32_t max_units) const {
    return panels(max_bytes, max_units, 0, units());
  }
  /// The same of the units [first, end) only.
  [[nodiscard]] std::vector<Panel> panels(std::uint64_t max_bytes, std::uint32_t max_units, std::uint32_t first,
                                          std::uint32_t end) const;
  /// Elements before each unit, and all; for dense16 and tiled16, whose units are strips, row 8 u begins unit u.
  [[nodiscard]] std::span<const std::uint64_t> elements_before() const { return unit_begin_; }

 private:
  struct Strip {
    std::uint32_t row = 0;         ///< its number in the matrix
    std::uint64_t first_tile = 0;  ///< its tiles' place in columns_
  };
  struct Chunk {  ///< elements of the units from `first` on
    std::uint32_t first = 0, end = 0;
    std::shared_ptr<PageBuffer> memory;
  };
  class Arena;
  struct Made {  ///< a strip of the matrix as tiles, before they have their place
    const Half* elements = nullptr;
    std::vector<std::uint32_t> columns;
    std::uint64_t nonzero = 0;
  };

  void set_scales(std::span<const double> area);
  void check_memory(std::uint64_t needed) const;
  void store_tiles(const FormFactorMatrix& form_factors);
  void make_strip(const FormFactorMatrix& form_factors, std::uint32_t strip, std::span<Half> rows, Arena& arena,
                  Made& made) const;
  void add_unit(const std::vector<Made>& made, std::uint32_t first_strip, std::uint32_t end_strip,
                std::uint32_t first_column, std::uint32_t end_column);
  void lay_out(const std::vector<Made>& made);
  void place_tiles(const std::vector<Made>& made);
  void make_chunks(std::uint64_t max_bytes);
  [[nodiscard]] Half* elements(std::uint32_t unit) const;
  [[nodiscard]] Panel panel(std::uint32_t first, std::uint32_t end) const;
  void add_index(Panel& panel) const;
  void place_row(const FormFactorMatrix& form_factors, std::uint32_t place, std::uint32_t first, Half* out) const;

  std::uint32_t n_ = 0, stride_ = 0, block_ = 0, block_rows_ = 0;
  Storage storage_ = Storage::dense16;
  std::uint64_t max_panel_bytes_ = 0, bytes_ = 0;
  double nonzero_fraction_ = 0;
  std::vector<std::uint32_t> order_;
  std::vector<float> scale_in_, scale_out_, inverse_;
  std::vector<std::uint64_t> unit_begin_{0};  ///< elements before each unit, and all
  std::vector<std::uint32_t> unit_strips_;    ///< strips before each unit, and all
  std::vector<Strip> strips_;                 ///< in the order of the tiles, and an end
  std::vector<std::uint32_t> columns_;        ///< tile column of each tile, in the matrix
  std::vector<Chunk> chunks_;
};

}  // namespace interflect
