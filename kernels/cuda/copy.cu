#include "blocks.cuh"

// Copies memory past the caches: with `read`, a device's bandwidth. Contract: kernels/README.md.
//
// Memory traffic of a launch: 64 * lines bytes read and as many written. A thread has four loads under way.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    copy(const float* __restrict__ from, float* __restrict__ to, const StreamArguments a) {
  constexpr unsigned in_flight = 4;
  const float4* source = reinterpret_cast<const float4*>(from);
  float4* target = reinterpret_cast<float4*>(to);
  const Index fours = Index{a.lines} * 4;
  const Index step = Index{gridDim.x} * WORKGROUP;
  Index i = Index{blockIdx.x} * WORKGROUP + threadIdx.x;
  for (; i + (in_flight - 1) * step < fours; i += in_flight * step) {
    float4 part[in_flight];
#pragma unroll
    for (unsigned k = 0; k < in_flight; ++k) part[k] = __ldcs(source + i + k * step);
#pragma unroll
    for (unsigned k = 0; k < in_flight; ++k) __stcs(target + i + k * step, part[k]);
  }
  for (; i < fours; i += step) __stcs(target + i, __ldcs(source + i));
}
