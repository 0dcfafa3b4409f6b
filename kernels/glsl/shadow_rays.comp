// Which rays meet a triangle of a hierarchy. Contract: kernels/README.md.
#include "shared.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint rays;
  uint nodes;
  uint leaves;
} a;

INPUT_WORDS(0, hierarchy_nodes)
INPUT_FOURS(1, hierarchy_leaves)
INPUT_FOURS(2, rays)
layout(set = 0, binding = 3, std430) writeonly restrict buffer Hidden { uint hidden[]; };

#include "../shared/occluded.h"

void main() {
  const uint groups = gl_NumWorkGroups.y;
  const uint share = (a.rays + groups - 1u) / groups;
  const uint first = gl_WorkGroupID.y * share;
  const uint end = min(a.rays, first + share);
  for (uint i = first + gl_LocalInvocationIndex; i < end; i += WORKGROUP) {
    const vec4 from = FOUR(rays, 2u * i);
    const vec4 to = FOUR(rays, 2u * i + 1u);
    hidden[i] = occluded(HIERARCHY from.xyz, to.xyz, from.w, to.w) ? 1u : 0u;
  }
}
