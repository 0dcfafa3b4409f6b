// One triangle of a symmetric matrix, block by block, each tile for its rows and for its columns. Contract, layout and
// error bound: kernels/README.md.
//
// Memory traffic of a launch of sym16: 256 bytes for each tile and 4 of index; for each block its slices of xs (read)
// and its two slots of partial sums (written), 16 BLOCK bytes a column together; within a block these stay in L1.
// Of sym16_fold: the slots once, y once.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "omp/sym16.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "interflect/base/half.h"
#include "interflect/device/kernel_arguments.h"
#include "omp/blocks.h"
#include "omp/table.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::omp::HWY_NAMESPACE {

#include "omp/packed.h"

/// A strip's tiles in one block, for `columns` columns: row_sum[c][q] += Σ tile[q] x[c] and, for each tile, its columns
/// of column_sum[c] += tile^T xi[.][c]. x[c] and column_sum[c] are the block's slices; xi[q][c] are the strip's
/// elements of xs.
template <std::size_t columns>
HWY_INLINE void multiply_strip(const Half* HWY_RESTRICT tiles, const std::uint32_t* HWY_RESTRICT tile_column,
                               std::size_t count, const float* const* HWY_RESTRICT x,
                               const float (*HWY_RESTRICT xi)[group], float* const* row_sum, float* const* column_sum,
                               std::size_t ahead) {
  const Tag d;
  for (std::size_t row = 0; row < tile_rows; row += strip_rows) {
    Vector sum[columns][strip_rows];
    HWY_UNROLL(group)
    for (std::size_t c = 0; c < columns; ++c) {
      HWY_UNROLL(strip_rows)
      for (std::size_t q = 0; q < strip_rows; ++q) sum[c][q] = hn::Zero(d);
    }
    const Half* tile = tiles + row * tile_columns;
    for (std::size_t t = 0; t < count; ++t, tile += tile_elements) {
      if (row == 0) prefetch_tile(tile, ahead);
      for (std::size_t part = 0; part < parts; ++part) {
        const std::size_t j = tile_column[t] * std::size_t{tile_columns} + part * lanes;
        Vector xj[columns], yj[columns];
        HWY_UNROLL(group)
        for (std::size_t c = 0; c < columns; ++c) {
          xj[c] = hn::LoadU(d, x[c] + j);
          keep(xj[c]);
          yj[c] = hn::LoadU(d, column_sum[c] + j);
        }
        HWY_UNROLL(strip_rows)
        for (std::size_t q = 0; q < strip_rows; ++q) {
          Vector h = load_halves(tile + q * tile_columns + part * lanes);
          keep(h);
          HWY_UNROLL(group)
          for (std::size_t c = 0; c < columns; ++c) {
            sum[c][q] = hn::MulAdd(h, xj[c], sum[c][q]);
            yj[c] = hn::MulAdd(h, hn::Set(d, xi[row + q][c]), yj[c]);
          }
        }
        HWY_UNROLL(group)
        for (std::size_t c = 0; c < columns; ++c) hn::StoreU(yj[c], d, column_sum[c] + j);
      }
    }
    HWY_UNROLL(group)
    for (std::size_t c = 0; c < columns; ++c) add_lane_sums(sum[c], row_sum[c] + row);
  }
}

/// Block k of the panel, for all columns.
HWY_ATTR void multiply_block(const SymmetricArguments& a, std::size_t columns, std::size_t block, const Half* tiles,
                             const std::uint32_t* index, const float* x, float* partial, std::size_t ahead,
                             std::size_t k) {
  const std::uint32_t* of_block = index + 4 * k;
  const std::uint32_t* strip_in_block = index + std::size_t{4} * a.blocks;
  const std::uint32_t* tile_begin = strip_in_block + a.strips;
  const std::uint32_t* tile_column = tile_begin + a.strips + 1;
  const std::size_t i = of_block[0], j = of_block[1];
  float* rows = partial + (i * a.block_rows + j) * columns * block;
  float* cols = partial + (j * a.block_rows + i) * columns * block;
  std::fill_n(rows, columns * block, 0.0F);
  std::fill_n(cols, columns * block, 0.0F);
  for (std::size_t s = of_block[2]; s < of_block[3]; ++s) {
    const std::size_t begin = tile_begin[s], count = tile_begin[s + 1] - begin;
    const std::size_t row = strip_in_block[s] * std::size_t{tile_rows};
    for (std::size_t c = 0; c < columns; c += group) {
      const std::size_t some = std::min(group, columns - c);
      const float* xj[group];
      float xi[tile_rows][group];
      float *row_sum[group], *column_sum[group];
      for (std::size_t g = 0; g < some; ++g) {
        const float* of_column = x + (c + g) * a.vector_stride;
        xj[g] = of_column + j * block;
        for (std::size_t q = 0; q < tile_rows; ++q) xi[q][g] = of_column[i * block + row + q];
        row_sum[g] = rows + (c + g) * block + row;
        column_sum[g] = cols + (c + g) * block;
      }
      const Half* of_strip = tiles + begin * tile_elements;
      switch (some) {
        case 1: multiply_strip<1>(of_strip, tile_column + begin, count, xj, xi, row_sum, column_sum, ahead); break;
        case 2: multiply_strip<2>(of_strip, tile_column + begin, count, xj, xi, row_sum, column_sum, ahead); break;
        default: multiply_strip<3>(of_strip, tile_column + begin, count, xj, xi, row_sum, column_sum, ahead); break;
      }
    }
  }
}

}  // namespace interflect::omp::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect::omp {

HWY_EXPORT(multiply_block);

void sym16(const Launch& launch) {
  const auto a = launch.arguments<SymmetricArguments>();
  const auto columns = static_cast<std::size_t>(launch.macro("COLUMNS"));
  const auto block = static_cast<std::size_t>(launch.macro("BLOCK"));
  const auto ahead = static_cast<std::size_t>(launch.macro("PREFETCH")) * 64;
  const Half* tiles = launch.pointer<const Half>(0);
  const auto* index = launch.pointer<const std::uint32_t>(1);
  const float* x = launch.floats(2);
  float* partial = launch.floats(3);
  const bool worth_threads = a.tiles > 128;
#pragma omp parallel for schedule(dynamic) if (worth_threads)
  for (std::size_t k = 0; k < a.blocks; ++k) {
    HWY_DYNAMIC_DISPATCH(multiply_block)(a, columns, block, tiles, index, x, partial, ahead, k);
  }
}

void sym16_fold(const Launch& launch) {
  const Vectors v(launch);
  const VectorArguments& a = v.arguments();
  const float* partial = v.floats(0);
  const float* scale = v.floats(1);
  float* y = v.floats(2);
  const std::uint64_t block_size = a.option, block_rows = a.slot;
  v.for_each_block([=](const Block& block) {
    const std::uint64_t offset = std::uint64_t{block.column} * a.vector_stride;
    for (std::uint64_t i = block.begin - offset; i < block.end - offset;) {
      const std::uint64_t block_row = i / block_size;
      const std::uint64_t count = std::min(block.end - offset, (block_row + 1) * block_size) - i;
      float sum[reduction_block] = {};
      for (std::uint64_t j = 0; j < block_rows; ++j) {
        const float* from =
            partial + ((block_row * block_rows + j) * a.columns + block.column) * block_size + i % block_size;
#pragma omp simd
        for (std::uint64_t k = 0; k < count; ++k) sum[k] += from[k];
      }
#pragma omp simd
      for (std::uint64_t k = 0; k < count; ++k) y[offset + i + k] = scale[i + k] * sum[k];
      i += count;
    }
  });
}

}  // namespace interflect::omp

#endif
