#include "blocks.cuh"

// y = F x as pairs hi + lo of floats, for one panel and all columns. Contract and error bound: kernels/README.md.
//
// Every product is split into its rounded value and what rounding took away (by fused multiply-add), every sum likewise
// (Knuth's two-sum; Ogita, Rump and Oishi 2005). The compiler folds products into additions where it can: not that of
// __fmul_rn, whose rounded value is needed. (Doubles would do as well on some GPUs; on most they take longer than this.)
//
// A work-group takes `strip` rows; its threads lie along the columns as in matvec.cu: thread t takes columns 4 t + 1,024 k
// of all rows. Memory traffic of a launch: F once, 4 * rows * n bytes, and from L2 for every further `chunk` columns of x.
//
// Order of sums: after `block` columns, 128 products of a thread, its pair of a row joins the row's total and begins again
// from zero; at the end the lanes of a warp join in a tree of 5 levels, then the 8 warps in order.

constexpr unsigned strip = 4;
constexpr unsigned chunk = COLUMNS < 3 ? COLUMNS : 3;  // columns in registers at once
constexpr unsigned block = 128 * WORKGROUP;

struct Pair {
  float hi, lo;
};

/// hi + lo = a + b, hi being the rounded sum.
__device__ Pair two_sum(float a, float b) {
  const float s = a + b;
  const float s_b = s - a;
  const float s_a = s - s_b;
  return {s, (a - s_a) + (b - s_b)};
}

__device__ void add_product(float f, float x, Pair& sum) {
  const float p = __fmul_rn(f, x);
  const float e = fmaf(f, x, -p);  // f x = p + e
  const Pair s = two_sum(sum.hi, p);
  sum = {s.hi, sum.lo + (s.lo + e)};
}

/// The sum of two pairs; |lo| is then at most a rounding of hi.
__device__ Pair joined(const Pair& one, const Pair& other) {
  const Pair s = two_sum(one.hi, other.hi);
  return two_sum(s.hi, s.lo + (one.lo + other.lo));
}

__device__ Pair of_warp(Pair mine) {
#pragma unroll
  for (unsigned offset = warp_size / 2; offset > 0; offset /= 2) {
    const Pair other = {__shfl_xor_sync(all_lanes, mine.hi, offset), __shfl_xor_sync(all_lanes, mine.lo, offset)};
    mine = joined(mine, other);
  }
  return mine;
}

/// sum[q][c] += Σ f[q][j] x[c][j] over this thread's j in [begin, end).
__device__ void multiply(const float* const (&f)[strip], const float* const (&x)[chunk], unsigned begin, unsigned end,
                         Pair (&sum)[strip][chunk]) {
  unsigned j = begin + 4 * threadIdx.x;
  for (; j + 4 <= end; j += 4 * WORKGROUP) {
    float4 fj[strip], xj[chunk];
#pragma unroll
    for (unsigned q = 0; q < strip; ++q) fj[q] = __ldg(reinterpret_cast<const float4*>(f[q] + j));
#pragma unroll
    for (unsigned c = 0; c < chunk; ++c) xj[c] = __ldg(reinterpret_cast<const float4*>(x[c] + j));
#pragma unroll
    for (unsigned q = 0; q < strip; ++q) {
#pragma unroll
      for (unsigned c = 0; c < chunk; ++c) {
        add_product(fj[q].x, xj[c].x, sum[q][c]);
        add_product(fj[q].y, xj[c].y, sum[q][c]);
        add_product(fj[q].z, xj[c].z, sum[q][c]);
        add_product(fj[q].w, xj[c].w, sum[q][c]);
      }
    }
  }
  for (unsigned k = j; k < end; ++k) {  // the last one to three columns: what lies behind them may be NaN
#pragma unroll
    for (unsigned c = 0; c < chunk; ++c) {
#pragma unroll
      for (unsigned q = 0; q < strip; ++q) add_product(f[q][k], x[c][k], sum[q][c]);
    }
  }
}

extern "C" __global__ void __launch_bounds__(WORKGROUP, 2)
    matvec_exact(const float* __restrict__ f, const float* __restrict__ x, float* __restrict__ y,
                 const MatvecArguments a) {
  __shared__ Pair of_warps[strip * COLUMNS][warps];
  const Index first = Index{blockIdx.x} * strip;
  if (first >= a.rows) return;
  const unsigned count = static_cast<unsigned>(a.rows - first < strip ? a.rows - first : strip);
  // Past the panel's last row, and the last column of x, that one is computed again and not stored.
  const float* row[strip];
#pragma unroll
  for (unsigned q = 0; q < strip; ++q) row[q] = f + (first + (q < count ? q : count - 1)) * a.row_stride;
  for (unsigned c = 0; c < COLUMNS; c += chunk) {
    const float* column[chunk];
    Pair total[strip][chunk];
#pragma unroll
    for (unsigned k = 0; k < chunk; ++k) {
      column[k] = x + Index{c + k < COLUMNS ? c + k : COLUMNS - 1} * a.vector_stride;
#pragma unroll
      for (unsigned q = 0; q < strip; ++q) total[q][k] = {0.0F, 0.0F};
    }
    for (unsigned begin = 0; begin < a.n; begin += block) {
      Pair sum[strip][chunk] = {};
      multiply(row, column, begin, a.n - begin < block ? a.n : begin + block, sum);
#pragma unroll
      for (unsigned q = 0; q < strip; ++q) {
#pragma unroll
        for (unsigned k = 0; k < chunk; ++k) total[q][k] = joined(total[q][k], sum[q][k]);
      }
    }
#pragma unroll
    for (unsigned q = 0; q < strip; ++q) {
#pragma unroll
      for (unsigned k = 0; k < chunk; ++k) {
        const Pair all = of_warp(total[q][k]);
        if (lane_id() == 0 && c + k < COLUMNS) of_warps[(c + k) * strip + q][warp_id()] = all;
      }
    }
  }
  __syncthreads();  // every warp's sums are there
  const unsigned q = threadIdx.x % strip;
  const unsigned c = threadIdx.x / strip;
  if (c < COLUMNS && q < count) {
    Pair all = of_warps[threadIdx.x][0];
    for (unsigned w = 1; w < warps; ++w) all = joined(all, of_warps[threadIdx.x][w]);
    const Index at = Index{c} * a.vector_stride + a.first + first + q;
    y[at] = all.hi;
    y[Index{COLUMNS} * a.vector_stride + at] = all.lo;
  }
}
