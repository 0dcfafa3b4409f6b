// y = t * (H xs) for the strips of one panel. Contract and error bound: kernels/README.md.
//
// Four invocations share a tile: each takes half its columns and every other row, four loads of eight halves that are under
// way together, 64 bytes side by side for each load; the next four take the next tile. (On lavapipe too: with more rows for
// an invocation its registers do not suffice.) A work-group takes CHUNK columns of x, as in matvec.comp.
//
// Order of sums: an invocation adds eight products and that to its sum of the row; after BLOCK tiles the sum joins the
// row's total; at the end the totals of the work-group are added (group_sum.comp).
#include "fours.comp"
#include "halves.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint n;
  uint first;
  uint strips;
  uint tiles;
  uint vector_stride;
} a;

INPUT_WORDS(0, tiles)
INPUT_WORDS(1, index)
INPUT_FOURS(2, xs)
layout(set = 0, binding = 3, std430) readonly restrict buffer Scale { float t[]; };
layout(set = 0, binding = 4, std430) writeonly restrict buffer Y { float y[]; };

#include "group_sum.comp"

const uint ROWS = TILE_ROWS / 2u;      // of a tile for an invocation
const uint TILES = WORKGROUP / 4u;    // side by side
const uint BLOCK = 64u;               // tiles of an invocation before its sums join the totals

uint column_of(uint c) { return gl_WorkGroupID.x * CHUNK + c; }
uint x_column[CHUNK];
uint own_half() { return gl_LocalInvocationIndex % 2u; }
uint own_row() { return gl_LocalInvocationIndex / 2u % 2u; }  // then every other

void add_tile(uint k, inout float sum[ROWS][CHUNK]) {
  const uint column = WORD(index, a.strips + 1u + k) * 4u;
  uvec4 words[ROWS];
  for (uint r = 0u; r < ROWS; ++r) words[r] = WORDS(tiles, k * TILE_WORDS + (own_row() + 2u * r) * 2u + own_half());
  Eight x[CHUNK];
  for (uint c = 0u; c < CHUNK; ++c) {
    const uint at = x_column[c] + column + 2u * own_half();
    x[c] = Eight(FOUR(xs, at), FOUR(xs, at + 1u));
  }
  for (uint r = 0u; r < ROWS; ++r) {
    const Eight f = eight(words[r]);
    for (uint c = 0u; c < CHUNK; ++c) sum[r][c] += dot8(f, x[c]);
  }
}

void strip(uint s) {
  const uint begin = WORD(index, s);
  const uint end = WORD(index, s + 1u);
  float total[ROWS][CHUNK];
  for (uint r = 0u; r < ROWS; ++r) {
    for (uint c = 0u; c < CHUNK; ++c) total[r][c] = 0.0;
  }
  uint k = begin + gl_LocalInvocationIndex / 4u;
  while (k < end) {
    float sum[ROWS][CHUNK];
    for (uint r = 0u; r < ROWS; ++r) {
      for (uint c = 0u; c < CHUNK; ++c) sum[r][c] = 0.0;
    }
    const uint last = min(end, k + BLOCK * TILES);
    do {
      add_tile(k, sum);
      k += TILES;
    } while (k < last);  // llvmpipe runs a loop whose condition stands first once more, masked
    for (uint r = 0u; r < ROWS; ++r) {
      for (uint c = 0u; c < CHUNK; ++c) total[r][c] += sum[r][c];
    }
  }
  for (uint r = 0u; r < TILE_ROWS; ++r) {
    const uint row = a.first + s * TILE_ROWS + r;
    for (uint c = 0u; c < CHUNK; ++c) {
      const float sum = group_sum(r % 2u == own_row() ? total[r / 2u][c] : 0.0);
      if (gl_LocalInvocationIndex == 0u && row < a.n && column_of(c) < COLUMNS) {
        y[column_of(c) * a.vector_stride + row] = t[row] * sum;
      }
    }
  }
}

void main() {
  for (uint c = 0u; c < CHUNK; ++c) x_column[c] = min(column_of(c), COLUMNS - 1u) * (a.vector_stride / 4u);
  const uint end = min(a.strips, (gl_WorkGroupID.y + 1u) * STRIPS);
  for (uint s = gl_WorkGroupID.y * STRIPS; s < end; ++s) strip(s);
}
