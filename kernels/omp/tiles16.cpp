// y = t ∘ (H xs) over tiles of halves, strip by strip. Contract, order of sums and error bound: kernels/README.md.
//
// Memory traffic of a launch: 256 bytes for each tile and 4 of index; xs from L2, 192 bytes for each tile and three
// columns.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "omp/tiles16.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "interflect/base/half.h"
#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::omp::HWY_NAMESPACE {

#include "omp/packed.h"

constexpr std::size_t chunk = 1024;  // tiles whose products go into one accumulator per lane before they join a total

/// sum[c][q] = Σ over `count` tiles of tile[row + q] * x[c], by lanes.
template <std::size_t columns>
HWY_INLINE void multiply_tiles(const Half* HWY_RESTRICT tiles, const std::uint32_t* HWY_RESTRICT column,
                               std::size_t count, const float* const* HWY_RESTRICT x, std::size_t row,
                               std::size_t ahead, Vector (&sum)[columns][strip_rows]) {
  const Tag d;
  const Half* tile = tiles + row * tile_columns;
  for (std::size_t t = 0; t < count; ++t, tile += tile_elements) {
    if (row == 0) prefetch_tile(tile, ahead);
    for (std::size_t part = 0; part < parts; ++part) {
      const std::size_t j = column[t] * std::size_t{tile_columns} + part * lanes;
      Vector xj[columns];
      HWY_UNROLL(group)
      for (std::size_t c = 0; c < columns; ++c) {
        xj[c] = hn::Load(d, x[c] + j);
        keep(xj[c]);
      }
      HWY_UNROLL(strip_rows)
      for (std::size_t q = 0; q < strip_rows; ++q) {
        Vector h = load_halves(tile + q * tile_columns + part * lanes);
        keep(h);
        HWY_UNROLL(group)
        for (std::size_t c = 0; c < columns; ++c) sum[c][q] = hn::MulAdd(h, xj[c], sum[c][q]);
      }
    }
  }
}

/// A strip's rows for `columns` columns: result[c][q].
template <std::size_t columns>
HWY_INLINE void multiply_strip(const Half* tiles, const std::uint32_t* column, std::size_t count, const float* const* x,
                               std::size_t ahead, float (*result)[tile_rows]) {
  const Tag d;
  for (std::size_t c = 0; c < columns; ++c) std::fill_n(result[c], tile_rows, 0.0F);
  for (std::size_t first = 0; first < count; first += chunk) {
    for (std::size_t row = 0; row < tile_rows; row += strip_rows) {
      Vector sum[columns][strip_rows];
      HWY_UNROLL(group)
      for (std::size_t c = 0; c < columns; ++c) {
        HWY_UNROLL(strip_rows)
        for (std::size_t q = 0; q < strip_rows; ++q) sum[c][q] = hn::Zero(d);
      }
      multiply_tiles<columns>(tiles + first * tile_elements, column + first, std::min(chunk, count - first), x, row,
                              ahead, sum);
      HWY_UNROLL(group)
      for (std::size_t c = 0; c < columns; ++c) add_lane_sums(sum[c], result[c] + row);
    }
  }
}

/// Strips [first, last) of the panel, for all columns.
HWY_ATTR void multiply_strips(const TileArguments& a, std::size_t columns, const Half* tiles,
                              const std::uint32_t* index, const float* x, const float* scale, float* y,
                              std::size_t ahead, std::size_t first, std::size_t last) {
  const std::uint32_t* column = index + a.strips + 1;
  for (std::size_t s = first; s < last; ++s) {
    const std::size_t begin = index[s], count = index[s + 1] - begin;
    for (std::size_t c = 0; c < columns; c += group) {
      const float* from[group];
      for (std::size_t k = 0; k < std::min(group, columns - c); ++k) from[k] = x + (c + k) * a.vector_stride;
      float result[group][tile_rows];
      const Half* of_strip = tiles + begin * tile_elements;
      switch (std::min(group, columns - c)) {
        case 1: multiply_strip<1>(of_strip, column + begin, count, from, ahead, result); break;
        case 2: multiply_strip<2>(of_strip, column + begin, count, from, ahead, result); break;
        default: multiply_strip<3>(of_strip, column + begin, count, from, ahead, result); break;
      }
      const std::size_t row = a.first + s * tile_rows;
      for (std::size_t k = 0; k < std::min(group, columns - c); ++k) {
        for (std::size_t q = 0; q < std::min<std::size_t>(tile_rows, a.n - row); ++q) {
          y[(c + k) * a.vector_stride + row + q] = scale[row + q] * result[k][q];
        }
      }
    }
  }
}

}  // namespace interflect::omp::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect::omp {

HWY_EXPORT(multiply_strips);

void tiles16(const Launch& launch) {
  constexpr std::size_t strips_per_task = 16;
  const auto a = launch.arguments<TileArguments>();
  const auto columns = static_cast<std::size_t>(launch.macro("COLUMNS"));
  const auto ahead = static_cast<std::size_t>(launch.macro("PREFETCH")) * 64;
  const Half* tiles = launch.pointer<const Half>(0);
  const auto* index = launch.pointer<const std::uint32_t>(1);
  const float* x = launch.floats(2);
  const float* scale = launch.floats(3);
  float* y = launch.floats(4);
  const std::size_t tasks = (a.strips + strips_per_task - 1) / strips_per_task;
  const bool worth_threads = a.tiles > 256;
#pragma omp parallel for schedule(dynamic) if (worth_threads)
  for (std::size_t task = 0; task < tasks; ++task) {
    const std::size_t first = task * strips_per_task;
    HWY_DYNAMIC_DISPATCH(multiply_strips)
    (a, columns, tiles, index, x, scale, y, ahead, first, std::min<std::size_t>(a.strips, first + strips_per_task));
  }
}

}  // namespace interflect::omp

#endif
