#include "blocks.cuh"

// S to F in place for one panel, and what the rows tell of it. Contract: kernels/README.md.
//
// A work-group takes `rows_of_group` rows at once; its threads lie along the columns, a 16-byte access each, so that a thread
// has four loads under way. Memory traffic of a launch: 4 * rows * n bytes read and as many written; d from L2.

constexpr unsigned rows_of_group = 4;
constexpr float largest_float = 3.402823466e38F;

struct Seen {
  float low, high, count;
};

__device__ Seen joined(const Seen& one, const Seen& other) {
  return {fminf(one.low, other.low), fmaxf(one.high, other.high), one.count + other.count};
}

__device__ float closed(float old, float by, float d, Seen& seen) {
  if (old != 0.0F) seen = joined(seen, {d, d, 1.0F});
  return old * (by * d);
}

__device__ Seen of_warp(Seen mine) {
#pragma unroll
  for (unsigned offset = warp_size / 2; offset > 0; offset /= 2) {
    const Seen other = {__shfl_xor_sync(all_lanes, mine.low, offset), __shfl_xor_sync(all_lanes, mine.high, offset),
                        __shfl_xor_sync(all_lanes, mine.count, offset)};
    mine = joined(mine, other);
  }
  return mine;
}

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    close_rows(float* __restrict__ s, const float* __restrict__ d, const float* __restrict__ factor,
               float* __restrict__ of_rows, const MatvecArguments a) {
  __shared__ Seen of_warps[rows_of_group][warps];
  const Index first = Index{blockIdx.x} * rows_of_group;
  const unsigned count =
      a.rows <= first ? 0 : static_cast<unsigned>(a.rows - first < rows_of_group ? a.rows - first : rows_of_group);
  float* row[rows_of_group];
  float by[rows_of_group];
  Seen seen[rows_of_group];
#pragma unroll
  for (unsigned r = 0; r < rows_of_group; ++r) {
    const Index at = r < count ? first + r : 0;
    row[r] = s + at * a.row_stride;
    by[r] = r < count ? factor[a.first + at] : 0.0F;
    seen[r] = {largest_float, 0.0F, 0.0F};
  }
  unsigned j = 4 * threadIdx.x;
  for (; j + 4 <= a.n; j += 4 * WORKGROUP) {
    const float4 dj = __ldg(reinterpret_cast<const float4*>(d + j));
#pragma unroll
    for (unsigned r = 0; r < rows_of_group; ++r) {
      if (r >= count) continue;
      float4* at = reinterpret_cast<float4*>(row[r] + j);
      const float4 old = *at;
      *at = make_float4(closed(old.x, by[r], dj.x, seen[r]), closed(old.y, by[r], dj.y, seen[r]),
                        closed(old.z, by[r], dj.z, seen[r]), closed(old.w, by[r], dj.w, seen[r]));
    }
  }
  for (unsigned k = j; k < a.n; ++k) {  // the last one to three columns: what lies behind them is padding
#pragma unroll
    for (unsigned r = 0; r < rows_of_group; ++r) {
      if (r < count) row[r][k] = closed(row[r][k], by[r], d[k], seen[r]);
    }
  }
#pragma unroll
  for (unsigned r = 0; r < rows_of_group; ++r) {
    const Seen all = of_warp(seen[r]);
    if (lane_id() == 0) of_warps[r][warp_id()] = all;
  }
  __syncthreads();  // every warp's row is there
  if (threadIdx.x < count) {
    Seen all = of_warps[threadIdx.x][0];
    for (unsigned w = 1; w < warps; ++w) all = joined(all, of_warps[threadIdx.x][w]);
    float* out = of_rows + a.first + first + threadIdx.x;
    out[0] = all.low;
    out[a.vector_stride] = all.high;
    out[2 * Index{a.vector_stride}] = all.count;
  }
}
