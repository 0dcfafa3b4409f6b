#include "blocks.cuh"

// Reads memory as fast as the device can: what every other kernel's rate is compared with. Contract: kernels/README.md.
// STREAMS is the number of 16-byte loads that a thread has under way.
//
// Memory traffic of a launch: 64 * lines bytes read, 4 * groups written.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    read(const float* __restrict__ data, float* __restrict__ sums, const StreamArguments a) {
  __shared__ float of_warp[warps];
  const Index first = Index{a.lines} * blockIdx.x / gridDim.x * 4;
  const Index last = Index{a.lines} * (blockIdx.x + 1ULL) / gridDim.x * 4;
  const float4* fours = reinterpret_cast<const float4*>(data);
  float4 sum[STREAMS] = {};
  Index i = first + threadIdx.x;
  for (; i + (STREAMS - 1) * WORKGROUP < last; i += STREAMS * WORKGROUP) {
    float4 part[STREAMS];
#pragma unroll
    for (unsigned s = 0; s < STREAMS; ++s) part[s] = __ldcs(fours + i + s * WORKGROUP);
#pragma unroll
    for (unsigned s = 0; s < STREAMS; ++s) {
      sum[s].x += part[s].x;
      sum[s].y += part[s].y;
      sum[s].z += part[s].z;
      sum[s].w += part[s].w;
    }
  }
  float total = 0;
  for (; i < last; i += WORKGROUP) {
    const float4 part = __ldcs(fours + i);
    total += (part.x + part.y) + (part.z + part.w);
  }
#pragma unroll
  for (unsigned s = 0; s < STREAMS; ++s) total += (sum[s].x + sum[s].y) + (sum[s].z + sum[s].w);
  total = warp_sum(total);
  if (lane_id() == 0) of_warp[warp_id()] = total;
  __syncthreads();
  if (threadIdx.x == 0) sums[blockIdx.x] = tree_of_warps(of_warp, 1);
}
