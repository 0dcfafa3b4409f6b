// S to F in place for one panel, and what the rows tell of it. Contract: kernels/README.md.
//
// A work-group takes ROWS rows at once; its invocations lie along the columns, four neighbours each: an invocation's loop has
// at most n / (4 WORKGROUP) iterations. Memory traffic of a launch: 4 * rows * n bytes read and as many written.

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint n;
  uint first;
  uint rows;
  uint row_stride;
  uint vector_stride;
} a;

layout(set = 0, binding = 0, std430) restrict buffer S { vec4 s[]; };
layout(set = 0, binding = 1, std430) readonly restrict buffer D { vec4 d[]; };
layout(set = 0, binding = 2, std430) readonly restrict buffer Factor { float factor[]; };
layout(set = 0, binding = 3, std430) writeonly restrict buffer OfRows { float of_rows[]; };

const uint ROWS = 4u;
const float largest_float = 3.402823466e38;

shared vec3 of_invocation[WORKGROUP];

vec3 joined(vec3 one, vec3 other) { return vec3(min(one.x, other.x), max(one.y, other.y), one.z + other.z); }

// Least and largest d and the count over the work-group, in invocation 0.
vec3 of_group(vec3 mine) {
  of_invocation[gl_LocalInvocationIndex] = mine;
  barrier();
  for (uint width = WORKGROUP / 2u; width > 0u; width /= 2u) {
    if (gl_LocalInvocationIndex < width) {
      of_invocation[gl_LocalInvocationIndex] =
          joined(of_invocation[gl_LocalInvocationIndex], of_invocation[gl_LocalInvocationIndex + width]);
    }
    barrier();
  }
  const vec3 all = of_invocation[0];
  barrier();  // before of_invocation is written again
  return all;
}

void main() {
  const uint begin = gl_WorkGroupID.y * ROWS;
  vec3 seen[ROWS];
  for (uint r = 0u; r < ROWS; ++r) seen[r] = vec3(largest_float, 0.0, 0.0);
  for (uint j = gl_LocalInvocationIndex; j * 4u < a.n; j += WORKGROUP) {
    const vec4 dj = d[j];
    const uint count = min(4u, a.n - j * 4u);
    // Loops whose ends are constants are unrolled: only the outer one counts against what lavapipe lets an invocation do.
    for (uint r = 0u; r < ROWS; ++r) {
      if (begin + r < a.rows) {
        const uint at = (begin + r) * (a.row_stride / 4u) + j;
        const vec4 old = s[at];
        for (uint k = 0u; k < 4u; ++k) {
          if (k < count && old[k] != 0.0) seen[r] = joined(seen[r], vec3(dj[k], dj[k], 1.0));
        }
        const vec4 closed = old * (factor[a.first + begin + r] * dj);
        if (count == 4u) {
          s[at] = closed;
        } else {  // what lies behind n is padding and keeps its bits
          s[at].x = closed.x;
          if (count > 1u) s[at].y = closed.y;
          if (count > 2u) s[at].z = closed.z;
        }
      }
    }
  }
  for (uint r = 0u; r < ROWS; ++r) {
    const vec3 all = of_group(seen[r]);
    if (gl_LocalInvocationIndex == 0u && begin + r < a.rows) {
      for (uint k = 0u; k < 3u; ++k) of_rows[k * a.vector_stride + a.first + begin + r] = all[k];
    }
  }
}
