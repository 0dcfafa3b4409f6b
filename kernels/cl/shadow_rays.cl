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
#if PACKET == 1
  for (uint i = first + (uint)get_local_id(0); i < end; i += WORKGROUP) {
    const float4 from = rays[2 * i];
    const float4 to = rays[2 * i + 1];
    hidden[i] = occluded(HIERARCHY from.xyz, to.xyz, from.w, to.w);
  }
#else
  for (uint i = first; i < end; i += PACKET) {
    float lane[8][PACKET];
    for (uint k = 0; k < PACKET; ++k) {
      const float4 from = rays[2 * min(i + k, end - 1)];
      const float4 to = rays[2 * min(i + k, end - 1) + 1];
      lane[0][k] = from.x;
      lane[1][k] = from.y;
      lane[2][k] = from.z;
      lane[3][k] = from.w;
      lane[4][k] = to.x;
      lane[5][k] = to.y;
      lane[6][k] = to.z;
      lane[7][k] = to.w;
    }
    const Rays r = trace(HIERARCHY make_rays(LOAD_REAL(lane[0]), LOAD_REAL(lane[1]), LOAD_REAL(lane[2]), LOAD_REAL(lane[4]),
                                             LOAD_REAL(lane[5]), LOAD_REAL(lane[6]), LOAD_REAL(lane[3]), LOAD_REAL(lane[7])));
    STORE_REAL(r.far, lane[7]);
    for (uint k = 0; k < PACKET && i + k < end; ++k) hidden[i + k] = lane[7][k] < lane[3][k];
  }
#endif
}
