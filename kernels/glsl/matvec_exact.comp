// y = F x as pairs hi + lo of floats, for one panel and all columns. Contract and error bound: kernels/README.md.
//
// Every product is split into its rounded value and what rounding took away, every sum likewise (Dekker 1971, Knuth; Ogita, Rump
// and Oishi 2005). fma() of Vulkan may round twice, so that products are split by their factors' halves of 12 bits. All of it is
// `precise`: no addition may be regrouped and no product folded into one.
//
// A work-group takes ROWS rows and CHUNK columns of x, as in matvec.comp; its invocations lie along the columns of F, a four
// of floats each. Memory traffic of a launch: F once, 4 * rows * n bytes, and again for every further chunk.
//
// Order of sums: after BLOCK fours an invocation's pair of a row joins the row's total and begins again from zero; at the end
// the invocations join in a tree.
#include "fours.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint n;
  uint first;
  uint rows;
  uint row_stride;
  uint vector_stride;
} a;

INPUT_FOURS(0, f)
INPUT_FOURS(1, x)
layout(set = 0, binding = 2, std430) writeonly restrict buffer Y { float y[]; };

const uint ROWS = 4u;
const uint BLOCK = 32u;

shared vec2 of_invocation[WORKGROUP];

// s.x + s.y = a + b, s.x being the rounded sum.
vec2 two_sum(float a, float b) {
  precise float s = a + b;
  precise float s_b = s - a;
  precise float s_a = s - s_b;
  precise float t = (a - s_a) + (b - s_b);
  return vec2(s, t);
}

// The upper 12 bits of the significand: products of such numbers, or of what is left of them, are exact.
vec4 upper(vec4 v) { return uintBitsToFloat(floatBitsToUint(v) & uvec4(0xFFFFF000u)); }

// sum += f x, f and x being cut into halves.
void add_product(float f, float f_hi, float f_lo, float x, float x_hi, float x_lo, inout vec2 sum) {
  precise float p = f * x;
  precise float e = f_lo * x_lo - (((p - f_hi * x_hi) - f_lo * x_hi) - f_hi * x_lo);  // f x = p + e
  const vec2 s = two_sum(sum.x, p);
  precise float lo = sum.y + (s.y + e);
  sum = vec2(s.x, lo);
}

// The sum of two pairs; |y| is then at most a rounding of x.
vec2 joined(vec2 one, vec2 other) {
  const vec2 s = two_sum(one.x, other.x);
  precise float w = s.y + (one.y + other.y);
  return two_sum(s.x, w);
}

vec2 of_group(vec2 mine) {
  of_invocation[gl_LocalInvocationIndex] = mine;
  barrier();
  for (uint width = WORKGROUP / 2u; width > 0u; width /= 2u) {
    if (gl_LocalInvocationIndex < width) {
      of_invocation[gl_LocalInvocationIndex] =
          joined(of_invocation[gl_LocalInvocationIndex], of_invocation[gl_LocalInvocationIndex + width]);
    }
    barrier();
  }
  const vec2 all = of_invocation[0];
  barrier();  // before of_invocation is written again
  return all;
}

uint row_of(uint r) { return gl_WorkGroupID.y * ROWS + r; }
uint column_of(uint c) { return gl_WorkGroupID.x * CHUNK + c; }

uint f_row[ROWS];
uint x_column[CHUNK];

void add_four(uint j, inout vec2 sum[ROWS][CHUNK]) {
  // Padding behind n is selected away, it may be NaN.
  const bvec4 inside = lessThan(uvec4(0u, 1u, 2u, 3u), uvec4(a.n - 4u * j));
  vec4 x_all[CHUNK], x_hi[CHUNK], x_lo[CHUNK];
  for (uint c = 0u; c < CHUNK; ++c) {
    x_all[c] = mix(vec4(0.0), FOUR(x, x_column[c] + j), inside);
    x_hi[c] = upper(x_all[c]);
    precise vec4 rest = x_all[c] - x_hi[c];
    x_lo[c] = rest;
  }
  for (uint r = 0u; r < ROWS; ++r) {
    const vec4 f_all = mix(vec4(0.0), FOUR(f, f_row[r] + j), inside);
    const vec4 f_hi = upper(f_all);
    precise vec4 f_lo = f_all - f_hi;
    for (uint c = 0u; c < CHUNK; ++c) {
      for (uint k = 0u; k < 4u; ++k) {
        add_product(f_all[k], f_hi[k], f_lo[k], x_all[c][k], x_hi[c][k], x_lo[c][k], sum[r][c]);
      }
    }
  }
}

void main() {
  // Past the last row or column the last one is computed again and not stored.
  for (uint r = 0u; r < ROWS; ++r) f_row[r] = min(row_of(r), a.rows - 1u) * (a.row_stride / 4u);
  for (uint c = 0u; c < CHUNK; ++c) x_column[c] = min(column_of(c), COLUMNS - 1u) * (a.vector_stride / 4u);
  const uint fours = (a.n + 3u) / 4u;
  vec2 total[ROWS][CHUNK];
  for (uint r = 0u; r < ROWS; ++r) {
    for (uint c = 0u; c < CHUNK; ++c) total[r][c] = vec2(0.0);
  }
  for (uint first = 0u; first < fours; first += BLOCK * WORKGROUP) {
    vec2 sum[ROWS][CHUNK];
    for (uint r = 0u; r < ROWS; ++r) {
      for (uint c = 0u; c < CHUNK; ++c) sum[r][c] = vec2(0.0);
    }
    const uint last = min(fours, first + BLOCK * WORKGROUP);
    for (uint j = first + gl_LocalInvocationIndex; j < last; j += WORKGROUP) add_four(j, sum);
    for (uint r = 0u; r < ROWS; ++r) {
      for (uint c = 0u; c < CHUNK; ++c) total[r][c] = joined(total[r][c], sum[r][c]);
    }
  }
  for (uint r = 0u; r < ROWS; ++r) {
    for (uint c = 0u; c < CHUNK; ++c) {
      const vec2 all = of_group(total[r][c]);
      if (gl_LocalInvocationIndex != 0u || row_of(r) >= a.rows || column_of(c) >= COLUMNS) continue;
      const uint at = column_of(c) * a.vector_stride + a.first + row_of(r);
      y[at] = all.x;
      y[COLUMNS * a.vector_stride + at] = all.y;
    }
  }
}
