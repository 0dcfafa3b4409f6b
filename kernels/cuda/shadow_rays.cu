#include "shared.cuh"
#include "../shared/occluded.h"

// Which rays meet a triangle of a hierarchy. Contract: kernels/README.md.

struct ShadowRayArguments {
  unsigned rays, nodes, leaves;
};

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    shadow_rays(const uint4* __restrict__ hierarchy_nodes, const float4* __restrict__ hierarchy_leaves,
                const float4* __restrict__ rays, unsigned* __restrict__ hidden, const ShadowRayArguments a) {
  const unsigned share = (a.rays + gridDim.x - 1) / gridDim.x;
  const unsigned first = blockIdx.x * share;
  const unsigned end = smaller(a.rays, first + share);
  for (unsigned i = first + threadIdx.x; i < end; i += WORKGROUP) {
    const float4 from = __ldg(rays + 2 * i);
    const float4 to = __ldg(rays + 2 * i + 1);
    hidden[i] = occluded(HIERARCHY VEC3(from.x, from.y, from.z), VEC3(to.x, to.y, to.z), from.w, to.w) ? 1 : 0;
  }
}
