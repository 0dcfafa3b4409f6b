// Copies memory: with `read`, a device's bandwidth. A line is 16 floats, four fours.
#include "fours.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments { uint lines; } a;

INPUT_FOURS(0, from)
layout(set = 0, binding = 1, std430) writeonly restrict buffer To { vec4 to[]; };

void main() {
  const uint groups = gl_NumWorkGroups.y;
  const uint share = (a.lines + groups - 1u) / groups;
  const uint first = gl_WorkGroupID.y * share;
  const uint end = min(a.lines, first + share) * 4u;
  for (uint i = first * 4u + gl_LocalInvocationIndex; i < end; i += WORKGROUP) to[i] = FOUR(from, i);
}
