// Sums memory as fast as it comes. Each invocation has STREAMS fours under way. Contract: kernels/README.md.
#include "fours.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments { uint lines; } a;

INPUT_FOURS(0, data)
layout(set = 0, binding = 1, std430) writeonly restrict buffer Sums { float sums[]; };

#include "group_sum.comp"

// ⌊lines group / groups⌋ without leaving 32 bits: there are less than 65,536 groups.
uint boundary(uint group) {
  const uint groups = gl_NumWorkGroups.y;
  return a.lines / groups * group + a.lines % groups * group / groups;
}

void main() {
  const uint end = boundary(gl_WorkGroupID.y + 1u) * 4u;
  vec4 sum[STREAMS];
  for (uint s = 0u; s < STREAMS; ++s) sum[s] = vec4(0.0);
  uint i = boundary(gl_WorkGroupID.y) * 4u + gl_LocalInvocationIndex;
  for (; i + (STREAMS - 1u) * WORKGROUP < end; i += STREAMS * WORKGROUP) {
    for (uint s = 0u; s < STREAMS; ++s) sum[s] += FOUR(data, i + s * WORKGROUP);
  }
  for (; i < end; i += WORKGROUP) sum[0] += FOUR(data, i);
  for (uint s = 1u; s < STREAMS; ++s) sum[0] += sum[s];
  const float all = group_sum((sum[0].x + sum[0].z) + (sum[0].y + sum[0].w));
  if (gl_LocalInvocationIndex == 0u) sums[gl_WorkGroupID.y] = all;
}
