// Which rays meet a triangle of a hierarchy. Contract: kernels/README.md.
#include "shared.cl"
#include "../shared/occluded.h"

typedef struct {
  uint rays, nodes, leaves;
} ShadowRayArguments;

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_shadow_rays(
    HIERARCHY_PARAMETERS global const float4* rays, global uint* hidden, const ShadowRayArguments a) {
  const uint share = (uint)((a.rays + get_num_groups(0) - 1) / get_num_groups(0));
  const uint first = (uint)get_group_id(0) * share;
  const uint end = min(a.rays, first + share);
  for (uint i = first + (uint)get_local_id(0) * PACKET; i < end; i += WORKGROUP * PACKET) {
    RayBatch batch;
    for (uint k = 0; k < PACKET; ++k) {
      const uint ray = min(i + k, end - 1);
      PUT_RAY(batch, k, rays[2 * ray], rays[2 * ray].w, rays[2 * ray + 1], rays[2 * ray + 1].w);
    }
    const uint found = occluded_batch(HIERARCHY batch);
    for (uint k = 0; k < PACKET && i + k < end; ++k) hidden[i + k] = found >> k & 1;
  }
}
