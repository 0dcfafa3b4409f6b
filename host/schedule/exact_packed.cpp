// F x in double on the host, of F as a 16-bit format has rounded it. Memory traffic: the tiles once; of sym16 twice,
// since a block's rows and its columns belong to different results.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/schedule/exact_packed.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/schedule/scheduler.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t rows = tile_rows, columns = tile_columns;
using Tag = hn::CappedTag<double, 8>;
constexpr std::size_t lanes = hn::MaxLanes(Tag());

HWY_INLINE hn::Vec<Tag> load_halves(const Half* from) {
  const hn::Rebind<float, Tag> single;
  const hn::Rebind<hwy::float16_t, Tag> half;
  return hn::PromoteTo(Tag(), hn::PromoteTo(single, hn::Load(half, reinterpret_cast<const hwy::float16_t*>(from))));
}

/// For the tiles of a strip and `Count` columns: y[c][row + q] += Σ tile[q][l] x[c][j + l] over all tiles.
template <std::size_t Count>
HWY_INLINE void add_rows(const Half* tile, const std::uint32_t* column, std::size_t tiles, std::size_t row,
                         const double* const* x, double* const* y) {
  const Tag d;
  hn::Vec<Tag> sum[rows][Count];
  for (auto& of_row : sum) std::fill_n(of_row, Count, hn::Zero(d));
  for (std::size_t t = 0; t < tiles; ++t, tile += rows * columns) {
    for (std::size_t l = 0; l < columns; l += lanes) {
      hn::Vec<Tag> xj[Count];
      for (std::size_t c = 0; c < Count; ++c) xj[c] = hn::LoadU(d, x[c] + column[t] * columns + l);
      HWY_UNROLL(rows)
      for (std::size_t q = 0; q < rows; ++q) {
        const auto h = load_halves(tile + q * columns + l);
        for (std::size_t c = 0; c < Count; ++c) sum[q][c] = hn::MulAdd(h, xj[c], sum[q][c]);
      }
    }
  }
  for (std::size_t q = 0; q < rows; ++q) {
    for (std::size_t c = 0; c < Count; ++c) y[c][row + q] += hn::GetLane(hn::SumOfLanes(d, sum[q][c]));
  }
}

/// The same for the columns: y[c][j + l] += Σ_q tile[q][l] x[c][row + q].
template <std::size_t Count>
HWY_INLINE void add_columns(const Half* tile, const std::uint32_t* column, std::size_t tiles, std::size_t row,
                            const double* const* x, double* const* y) {
  const Tag d;
  for (std::size_t t = 0; t < tiles; ++t, tile += rows * columns) {
    for (std::size_t l = 0; l < columns; l += lanes) {
      const std::size_t j = column[t] * columns + l;
      hn::Vec<Tag> sum[Count];
      for (std::size_t c = 0; c < Count; ++c) sum[c] = hn::LoadU(d, y[c] + j);
      HWY_UNROLL(rows)
      for (std::size_t q = 0; q < rows; ++q) {
        const auto h = load_halves(tile + q * columns + l);
        for (std::size_t c = 0; c < Count; ++c) sum[c] = hn::MulAdd(h, hn::Set(d, x[c][row + q]), sum[c]);
      }
      for (std::size_t c = 0; c < Count; ++c) hn::StoreU(sum[c], d, y[c] + j);
    }
  }
}

template <std::size_t Count>
HWY_INLINE void add_strip(const Half* tile, const std::uint32_t* column, std::size_t tiles, std::size_t row,
                          const double* const* x, double* const* y, bool by_rows, bool by_columns) {
  if (by_rows) add_rows<Count>(tile, column, tiles, row, x, y);
  if (by_columns) add_columns<Count>(tile, column, tiles, row, x, y);
}

HWY_ATTR void add_tiles(const Half* tile, const std::uint32_t* column, std::size_t tiles, std::size_t row,
                        std::size_t count, const double* const* x, double* const* y, bool by_rows, bool by_columns) {
  for (std::size_t c = 0; c < count; c += 3) {
    switch (std::min<std::size_t>(3, count - c)) {
      case 1: add_strip<1>(tile, column, tiles, row, x + c, y + c, by_rows, by_columns); break;
      case 2: add_strip<2>(tile, column, tiles, row, x + c, y + c, by_rows, by_columns); break;
      default: add_strip<3>(tile, column, tiles, row, x + c, y + c, by_rows, by_columns); break;
    }
  }
}

}  // namespace interflect::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect {

HWY_EXPORT(add_tiles);

namespace {

using Wide = std::vector<std::vector<double>>;

/// A unit of H, or its transpose, or both, times x, added to y.
struct Use {
  std::uint32_t unit;
  bool by_rows, by_columns;
};

void add(const PackedMatrix& h, const Use& use, const std::vector<const double*>& x, const std::vector<double*>& y) {
  h.for_each_strip(use.unit, [&](std::uint32_t row, std::span<const std::uint32_t> column, const Half* tiles) {
    HWY_DYNAMIC_DISPATCH(add_tiles)
    (tiles, column.data(), column.size(), row, x.size(), x.data(), y.data(), use.by_rows, use.by_columns);
  });
}

/// What each thread does alone: a strip, or all that goes into the results of one block row of sym16, which are the
/// blocks right of the diagonal by their rows and those above it by their columns, in the order in which they lie.
std::vector<std::vector<Use>> shares(const PackedMatrix& h) {
  std::vector<std::vector<Use>> all;
  if (h.storage() != Storage::sym16) {
    for (std::uint32_t u = 0; u < h.units(); ++u) all.push_back({{u, true, false}});
    return all;
  }
  all.resize(h.block_rows());
  for (std::uint32_t u = 0; u < h.units(); ++u) {
    const auto [i, j] = h.block_of(u);
    all[i].push_back({u, true, i == j});
    if (i != j) all[j].push_back({u, false, true});
  }
  return all;
}

}  // namespace

void exact_product(const PackedMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y) {
  const std::uint32_t n = form_factors.size();
  const auto order = form_factors.order();
  Wide scaled(x.size(), std::vector<double>(form_factors.stride()));
  for (std::size_t c = 0; c < x.size(); ++c) {
    if (x[c].size() != n) throw Error(ErrorKind::internal, "exact product: a column of the wrong length");
    for (std::uint32_t k = 0; k < n; ++k) {
      scaled[c][k] = static_cast<double>(form_factors.scale_in()[k]) * static_cast<double>(x[c][order[k]]);
    }
  }
  Wide sums(x.size(), std::vector<double>(form_factors.stride()));
  std::vector<const double*> from;
  std::vector<double*> to;
  for (std::size_t c = 0; c < x.size(); ++c) {
    from.push_back(scaled[c].data());
    to.push_back(sums[c].data());
  }
  const std::vector<std::vector<Use>> all = shares(form_factors);
#pragma omp parallel for schedule(dynamic)
  for (std::size_t k = 0; k < all.size(); ++k) {
    for (const Use& use : all[k]) add(form_factors, use, from, to);
  }
  y.assign(x.size(), std::vector<double>(n));
  for (std::size_t c = 0; c < x.size(); ++c) {
    for (std::uint32_t k = 0; k < n; ++k) {
      y[c][order[k]] = static_cast<double>(form_factors.scale_out()[k]) * sums[c][k];
    }
  }
}

}  // namespace interflect

#endif
