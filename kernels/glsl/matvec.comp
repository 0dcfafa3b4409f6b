// y = F x for one panel and all columns. Contract and error bound: kernels/README.md.
//
// A work-group takes ROWS rows and, of the columns of x, CHUNK: work-group (k, g) the k-th chunk of the g-th strip of
// rows, so that the chunks of a strip run side by side and F comes from the cache for all but the first. Its
// invocations lie along the columns of F, each with a four of floats; a four of x serves all rows of the strip.
//
// Memory traffic of a launch: F once, 4 * rows * n bytes; x and y are small beside it.
//
// Order of sums: an invocation adds the four products of a four one after the other and that to its sum of the row;
// after BLOCK fours the sum joins the row's total and begins again from zero; at the end the totals of the work-group
// are added, by subgroups and these in order, or in a tree in shared memory (group_sum.comp).
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

#include "group_sum.comp"

// Where a work-group has several subgroups their sums meet in shared memory, all rows and columns behind one barrier.
#if defined(SUBGROUPS) && SUBGROUPS > 1 && ROWS * CHUNK * SUBGROUPS <= 2048
#define SUMS_TOGETHER
shared float sums_of_subgroups[ROWS * CHUNK * SUBGROUPS];
#endif

const uint BLOCK = 64u;

uint row_of(uint r) { return gl_WorkGroupID.y * ROWS + r; }
uint column_of(uint c) { return gl_WorkGroupID.x * CHUNK + c; }

uint f_row[ROWS];
uint x_column[CHUNK];

// Past the last row or column the last one is computed again and not stored.
void take_strip() {
  for (uint r = 0u; r < ROWS; ++r) f_row[r] = min(row_of(r), a.rows - 1u) * (a.row_stride / 4u);
  for (uint c = 0u; c < CHUNK; ++c) x_column[c] = min(column_of(c), COLUMNS - 1u) * (a.vector_stride / 4u);
}

void store_one(uint r, uint c, float sum) {
  if (row_of(r) < a.rows && column_of(c) < COLUMNS) y[column_of(c) * a.vector_stride + a.first + row_of(r)] = sum;
}

#ifdef SUMS_TOGETHER
void store(float total[ROWS][CHUNK]) {
  for (uint r = 0u; r < ROWS; ++r) {
    for (uint c = 0u; c < CHUNK; ++c) {
      const float sum = subgroupAdd(total[r][c]);
      if (subgroupElect()) sums_of_subgroups[(r * CHUNK + c) * SUBGROUPS + gl_SubgroupID] = sum;
    }
  }
  barrier();
  for (uint k = gl_LocalInvocationIndex; k < ROWS * CHUNK; k += WORKGROUP) {
    float sum = 0.0;
    for (uint s = 0u; s < gl_NumSubgroups; ++s) sum += sums_of_subgroups[k * SUBGROUPS + s];
    store_one(k / CHUNK, k % CHUNK, sum);
  }
}
#else
void store(float total[ROWS][CHUNK]) {
  for (uint r = 0u; r < ROWS; ++r) {
    for (uint c = 0u; c < CHUNK; ++c) {
      const float sum = group_sum(total[r][c]);
      if (gl_LocalInvocationIndex == 0u) store_one(r, c, sum);
    }
  }
}
#endif

void main() {
  take_strip();
  const uint whole = a.n / 4u;
  float total[ROWS][CHUNK];
  for (uint r = 0u; r < ROWS; ++r) {
    for (uint c = 0u; c < CHUNK; ++c) total[r][c] = 0.0;
  }
  for (uint first = 0u; first < whole; first += BLOCK * WORKGROUP) {
    float sum[ROWS][CHUNK];
    for (uint r = 0u; r < ROWS; ++r) {
      for (uint c = 0u; c < CHUNK; ++c) sum[r][c] = 0.0;
    }
    const uint last = min(whole, first + BLOCK * WORKGROUP);
    for (uint j = first + gl_LocalInvocationIndex; j < last; j += WORKGROUP) {
      vec4 xj[CHUNK];
      for (uint c = 0u; c < CHUNK; ++c) xj[c] = FOUR(x, x_column[c] + j);
      for (uint r = 0u; r < ROWS; ++r) {
        const vec4 fj = FOUR(f, f_row[r] + j);
        for (uint c = 0u; c < CHUNK; ++c) sum[r][c] += dot(fj, xj[c]);
      }
    }
    for (uint r = 0u; r < ROWS; ++r) {
      for (uint c = 0u; c < CHUNK; ++c) total[r][c] += sum[r][c];
    }
  }
  // The last four when n cuts it: padding is selected away, it may be NaN.
  if (a.n % 4u != 0u && gl_LocalInvocationIndex == whole % WORKGROUP) {
    const bvec4 inside = lessThan(uvec4(0u, 1u, 2u, 3u), uvec4(a.n % 4u));
    for (uint r = 0u; r < ROWS; ++r) {
      const vec4 fj = mix(vec4(0.0), FOUR(f, f_row[r] + whole), inside);
      for (uint c = 0u; c < CHUNK; ++c) {
        total[r][c] += dot(fj, mix(vec4(0.0), FOUR(x, x_column[c] + whole), inside));
      }
    }
  }
  store(total);
}
