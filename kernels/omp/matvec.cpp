// y = F x for one panel and all columns. Contract, order of sums and error bound: kernels/README.md.
//
// Memory traffic of a launch: F once, 4 * rows * n bytes, whatever the number of columns; y once, 4 * rows * columns
// bytes; x once from memory (4 * n * columns bytes), then from L2 for each strip of rows: three fourths of a vector of
// x per vector of F at 4 rows, three eighths at 8. At 17,128 patches and 3 columns F is 1.17 GB, x and y are 0.2 MB
// each.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "omp/matvec.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::omp::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, 16>;  // a row of F is a whole number of these
using Vector = hn::Vec<Tag>;

constexpr std::size_t lanes = hn::MaxLanes(Tag());
constexpr std::size_t largest_columns = 24;
constexpr std::size_t group = 3;  // columns in registers at once
constexpr std::size_t groups = largest_columns / group;
// Rows in registers at once: accumulators, three vectors of x and one of F must fit 32 or 16 registers. As many rows
// are read at once, so that each core has several streams under way.
constexpr std::size_t strip = lanes == 16 ? 8 : 4;
// Columns whose products go into one accumulator per lane before they join the row's total: the longest chain of
// additions is 64 (AVX-512) to 256 (SSE4, scalar).
constexpr std::size_t block = lanes == 1 ? 256 : 1024;

/// Keeps the vector in a register. Without it GCC folds a load of x or F into each of the fused multiply-adds that use
/// it and reads it from the cache once per row or column instead of once.
HWY_INLINE void keep([[maybe_unused]] Vector& v) {
#if HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128
  asm("" : "+v"(v.raw));
#endif
}

/// total[q][c] += Σ_j f[q][j] * x[c][j] by lanes, for j in [begin, end); end may cut a vector: what lies behind it is
/// read (rows and columns are padded) and dropped.
template <std::size_t columns>
HWY_INLINE void add_block(const float* const* HWY_RESTRICT f, const float* const* HWY_RESTRICT x, std::size_t begin,
                          std::size_t end, Vector (*HWY_RESTRICT total)[group]) {
  const Tag d;
  Vector sum[strip][columns];
  HWY_UNROLL(strip)
  for (std::size_t q = 0; q < strip; ++q) {
    HWY_UNROLL(group)
    for (std::size_t c = 0; c < columns; ++c) sum[q][c] = hn::Zero(d);
  }
  const std::size_t whole = begin + (end - begin) / lanes * lanes;
  for (std::size_t j = begin; j < whole; j += lanes) {
    Vector xj[columns];
    HWY_UNROLL(group)
    for (std::size_t c = 0; c < columns; ++c) {
      xj[c] = hn::Load(d, x[c] + j);
      keep(xj[c]);
    }
    HWY_UNROLL(strip)
    for (std::size_t q = 0; q < strip; ++q) {
      Vector fj = hn::Load(d, f[q] + j);
      keep(fj);
      HWY_UNROLL(group)
      for (std::size_t c = 0; c < columns; ++c) sum[q][c] = hn::MulAdd(fj, xj[c], sum[q][c]);
    }
  }
  if (whole < end) {
    const auto inside = hn::FirstN(d, end - whole);
    for (std::size_t q = 0; q < strip; ++q) {
      const Vector fj = hn::MaskedLoad(inside, d, f[q] + whole);
      for (std::size_t c = 0; c < columns; ++c) {
        sum[q][c] = hn::MulAdd(fj, hn::MaskedLoad(inside, d, x[c] + whole), sum[q][c]);
      }
    }
  }
  HWY_UNROLL(strip)
  for (std::size_t q = 0; q < strip; ++q) {
    HWY_UNROLL(group)
    for (std::size_t c = 0; c < columns; ++c) total[q][c] = hn::Add(total[q][c], sum[q][c]);
  }
}

/// A strip of rows [row, row + strip) of the panel, for all columns. Past the panel's last row it computes that row
/// again and stores nothing, so that a row's sum never depends on where strips and threads begin.
HWY_ATTR void multiply_strip(const MatvecArguments& a, std::size_t columns, const float* f, const float* x, float* y,
                             std::size_t row) {
  const Tag d;
  const float* rows[strip];
  for (std::size_t q = 0; q < strip; ++q) rows[q] = f + std::min<std::size_t>(row + q, a.rows - 1) * a.row_stride;
  const float* column[largest_columns];
  for (std::size_t c = 0; c < columns; ++c) column[c] = x + c * a.vector_stride;
  Vector total[groups][strip][group];
  for (std::size_t g = 0; g * group < columns; ++g) {
    for (auto& sums : total[g]) std::fill_n(sums, group, hn::Zero(d));
  }

  // While a block of the strip is in the cache, every group of columns uses it: F comes from memory once.
  for (std::size_t begin = 0; begin < a.n; begin += block) {
    const std::size_t end = std::min<std::size_t>(a.n, begin + block);
    for (std::size_t c = 0; c < columns; c += group) {
      switch (std::min(group, columns - c)) {
        case 1: add_block<1>(rows, column + c, begin, end, total[c / group]); break;
        case 2: add_block<2>(rows, column + c, begin, end, total[c / group]); break;
        default: add_block<3>(rows, column + c, begin, end, total[c / group]); break;
      }
    }
  }

  for (std::size_t c = 0; c < columns; ++c) {
    float* out = y + c * a.vector_stride + a.first + row;
    for (std::size_t q = 0; q < std::min<std::size_t>(strip, a.rows - row); ++q) {
      out[q] = hn::GetLane(hn::SumOfLanes(d, total[c / group][q][c % group]));
    }
  }
}

/// Strips first, first + strip, ... up to row `last`.
HWY_ATTR void multiply_rows(const MatvecArguments& a, std::size_t columns, const float* f, const float* x, float* y,
                            std::size_t first, std::size_t last) {
  for (std::size_t row = first; row < last; row += strip) multiply_strip(a, columns, f, x, y, row);
}

}  // namespace interflect::omp::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect::omp {

HWY_EXPORT(multiply_rows);

namespace {

constexpr std::size_t rows_per_task = 128;  // a multiple of every strip; enough to outweigh handing it out

}  // namespace

void matvec(const Launch& launch) {
  const auto a = launch.arguments<MatvecArguments>();
  const auto columns = static_cast<std::size_t>(launch.macro("COLUMNS"));
  const float* f = launch.floats(0);
  const float* x = launch.floats(1);
  float* y = launch.floats(2);

  const std::size_t tasks = (a.rows + rows_per_task - 1) / rows_per_task;
  const bool worth_threads = std::uint64_t{a.rows} * a.n > 32768;  // below, waking them takes longer than the work
#pragma omp parallel for schedule(dynamic) if (worth_threads)
  for (std::size_t task = 0; task < tasks; ++task) {
    const std::size_t first = task * rows_per_task;
    HWY_DYNAMIC_DISPATCH(multiply_rows)
    (a, columns, f, x, y, first, std::min<std::size_t>(a.rows, first + rows_per_task));
  }
}

}  // namespace interflect::omp

#endif
