#include "blocks.cuh"

// y = F x for one panel and all columns. Contract and error bound: kernels/README.md.
//
// A work-group takes ROWS rows in strips of 8. Its threads lie side by side along the columns: thread t takes columns
// 4 t + 1,024 k, of all 8 rows at once, so that a thread has eight 16-byte loads of F and those of x under way before
// the first is used, and each x serves 8 rows. A warp reads 512 bytes of a row at a time. Two work-groups fit a
// multiprocessor: up to 64 KB of F under way in each, where 3.35 TB/s times 700 ns need 18 KB of each of 132.
//
// Memory traffic of a launch: F once, 4 * rows * n bytes; x from L2 once for each strip, 1/8 of a vector of x per
// vector of F and column; y once. More than 6 columns do not fit in registers: there F is cut into segments of 4,096
// columns, which come from memory once and then from L2 for every further chunk of columns.
//
// Order of sums: a thread adds its products of a segment by fused multiply-add, 4 ⌈columns / 1,024⌉ of them; the lanes
// of a warp join in a tree of 5 levels; a warp adds its segments in order; the 8 warps join in a tree of 3. At most 4
// ⌈n / 1,024⌉ + ⌈n / 4,096⌉ + 8 roundings: below the bound. A row's sum depends on that row and x only.

constexpr unsigned strip = 8;
constexpr unsigned chunks = (COLUMNS + 5) / 6;
constexpr unsigned chunk = (COLUMNS + chunks - 1) / chunks;  // columns in registers at once
constexpr unsigned largest_n = 1U << 20;
constexpr unsigned segment = chunks == 1 ? largest_n : 4096;

/// The sums of eight rows over a warp in 9 exchanges: half of the lanes give half of the rows to the other half, and so
/// on. Lane l returns row l / 4.
__device__ float strip_sum(float (&row)[strip]) {
#pragma unroll
  for (unsigned half = strip / 2, offset = warp_size / 2; half > 0; half /= 2, offset /= 2) {
    const bool upper = (lane_id() & offset) != 0;
#pragma unroll
    for (unsigned q = 0; q < half; ++q) {
      const float given = upper ? row[q] : row[q + half];
      const float kept = upper ? row[q + half] : row[q];
      row[q] = kept + __shfl_xor_sync(all_lanes, given, offset);
    }
  }
  row[0] += __shfl_xor_sync(all_lanes, row[0], 2);
  row[0] += __shfl_xor_sync(all_lanes, row[0], 1);
  return row[0];
}

__device__ float4 load_f(const float4* f) {
  if (chunks == 1) return __ldcs(f);  // used once
  return __ldg(f);
}

/// sum[c][q] += Σ f[q][j] x[c][j] over this thread's j in [begin, end). offset: of the strip's rows, in fours.
__device__ void multiply(const float4* f, const unsigned (&offset)[strip], const float4* x,
                         const unsigned (&column)[chunk], unsigned begin, unsigned end, float (&sum)[chunk][strip]) {
  unsigned j = begin / 4 + threadIdx.x;
  for (; 4 * j + 3 < end; j += WORKGROUP) {
    float4 fj[strip];
#pragma unroll
    for (unsigned q = 0; q < strip; ++q) fj[q] = load_f(f + offset[q] + j);
    float4 xj[chunk];
#pragma unroll
    for (unsigned c = 0; c < chunk; ++c) xj[c] = __ldg(x + column[c] + j);
#pragma unroll
    for (unsigned q = 0; q < strip; ++q) {  // rows in the order in which they arrive
#pragma unroll
      for (unsigned c = 0; c < chunk; ++c) {
        sum[c][q] = fmaf(fj[q].x, xj[c].x, sum[c][q]);
        sum[c][q] = fmaf(fj[q].y, xj[c].y, sum[c][q]);
        sum[c][q] = fmaf(fj[q].z, xj[c].z, sum[c][q]);
        sum[c][q] = fmaf(fj[q].w, xj[c].w, sum[c][q]);
      }
    }
  }
  // The last one to three columns, one by one: what lies behind them may be NaN.
  for (unsigned k = 4 * j; k < end; ++k) {
#pragma unroll
    for (unsigned c = 0; c < chunk; ++c) {
      const float xk = reinterpret_cast<const float*>(x + column[c])[k];
#pragma unroll
      for (unsigned q = 0; q < strip; ++q) {
        sum[c][q] = fmaf(reinterpret_cast<const float*>(f + offset[q])[k], xk, sum[c][q]);
      }
    }
  }
}

extern "C" __global__ void __launch_bounds__(WORKGROUP, 2)
    matvec(const float* __restrict__ f, const float* __restrict__ x, float* __restrict__ y, const MatvecArguments a) {
  __shared__ float of_warp[warps][COLUMNS * strip];
  for (unsigned from = 0; from < ROWS; from += strip) {
    const Index first = Index{blockIdx.x} * ROWS + from;
    if (first >= a.rows) return;
    const unsigned in_group = ROWS - from < strip ? ROWS - from : strip;
    const unsigned in_panel = static_cast<unsigned>(a.rows - first < in_group ? a.rows - first : in_group);
    // Past the panel's last row that row is computed again and not stored.
    unsigned offset[strip];
#pragma unroll
    for (unsigned q = 0; q < strip; ++q) offset[q] = (q < in_panel ? q : in_panel - 1) * (a.row_stride / 4);
    const float4* rows = reinterpret_cast<const float4*>(f + first * a.row_stride);

    for (unsigned begin = 0; begin < a.n; begin += segment) {
      const unsigned end = a.n - begin < segment ? a.n : begin + segment;
      for (unsigned c = 0; c < COLUMNS; c += chunk) {
        unsigned column[chunk];
#pragma unroll
        for (unsigned k = 0; k < chunk; ++k) {
          column[k] = (c + k < COLUMNS ? c + k : COLUMNS - 1) * (a.vector_stride / 4);
        }
        float sum[chunk][strip] = {};
        multiply(rows, offset, reinterpret_cast<const float4*>(x), column, begin, end, sum);
#pragma unroll
        for (unsigned k = 0; k < chunk; ++k) {
          const float total = strip_sum(sum[k]);
          if (c + k < COLUMNS && lane_id() % 4 == 0) {
            float& so_far = of_warp[warp_id()][(c + k) * strip + lane_id() / 4];
            so_far = begin == 0 ? total : so_far + total;
          }
        }
      }
    }
    __syncthreads();  // every warp's sums are there
    const unsigned q = threadIdx.x % strip;
    const unsigned c = threadIdx.x / strip;
    if (c < COLUMNS && q < in_panel) {
      y[Index{c} * a.vector_stride + a.first + first + q] = tree_of_warps(of_warp[0] + threadIdx.x, COLUMNS * strip);
    }
    __syncthreads();  // the next strip may write again
  }
}
