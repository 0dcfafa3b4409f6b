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
  for (uint i = first + (uint)get_local_id(0); i < end; i += WORKGROUP) {
    const float4 from = rays[2 * i];
    const float4 to = rays[2 * i + 1];
    hidden[i] = occluded(HIERARCHY from.xyz, to.xyz, from.w, to.w);
  }
}
