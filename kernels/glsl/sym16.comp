// sym16 and sym16_fold. Contract and error bounds: kernels/README.md.
//
// sym16: a work-group takes a block. An invocation owns half of a tile column and goes down the block's strips: it keeps the
// sums of its eight columns, and what its tile adds to the sums of the rows is joined over the work-group strip by strip, by
// exchanges within a subgroup of eight or through shared memory. Where the work-group is narrower than the block, it goes
// down again for the next tile columns. `partial` is added to by one invocation at a time in a fixed order, without atomics. On lavapipe: sym16_exchange.comp.
#include "fours.comp"

#ifdef KERNEL_sym16
#include "halves.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint blocks;
  uint strips;
  uint tiles;
  uint block_rows;
  uint vector_stride;
} a;

INPUT_WORDS(0, tiles)
INPUT_WORDS(1, index)
INPUT_FOURS(2, xs)
SUM_FOURS(3, partial)

const uint SIDE = BLOCK / 4u;           // fours along a side of the block
const uint TILE_COLUMNS = BLOCK / 16u;  // 64 at most
const uint MOST_STRIPS = BLOCK / 8u;

// An invocation takes half a tile's columns and, of its rows, both quads or one.
#ifdef TEXEL
#define ROW_PARTS 1u
#else
#define ROW_PARTS 2u
#endif
const uint QUADS = 2u / ROW_PARTS;
const uint TILES = WORKGROUP / (2u * ROW_PARTS);  // side by side
#define lane gl_LocalInvocationIndex
uint own_half() { return lane % 2u; }
uint own_tile() { return lane / 2u % TILES; }
uint own_part() { return lane / (2u * TILES); }

uint block_row, block_column;
uint x_column[CHUNK];
uint rows_at[CHUNK];  // first fours of the sums of rows and of columns in `partial`
uint columns_at[CHUNK];

uint column_of(uint c) { return gl_WorkGroupID.x * CHUNK + c; }
uint slot(uint i, uint j, uint c) { return ((i * a.block_rows + j) * COLUMNS + column_of(c)) * SIDE; }

// What the block's strips hold, by their order: number in the block, first tile, which of 64 tile columns (two words).
shared uvec4 strips[MOST_STRIPS];

void list_strips(uint first, uint count) {
  const uint numbers = 4u * a.blocks;
  const uint begins = numbers + a.strips;
  const uint columns = begins + a.strips + 1u;
  for (uint t = lane; t < count; t += WORKGROUP) {
    const uint begin = WORD(index, begins + first + t);
    const uint end = WORD(index, begins + first + t + 1u);
    uvec2 there = uvec2(0u);
    for (uint k = begin; k < end; ++k) {
      const uint column = WORD(index, columns + k);
      const uint bit = 1u << (column % 32u);
      there |= column < 32u ? uvec2(bit, 0u) : uvec2(0u, bit);
    }
    strips[t] = uvec4(WORD(index, numbers + first + t), begin, there);
  }
}

void add_four(uint at, vec4 value) { SET_FOUR(partial, at, FOUR(partial, at) + value); }

#if defined(SHUFFLES) && WORKGROUP == 8
#define EXCHANGE
#define WAIT() subgroupBarrier()
#else
#define WAIT() barrier()
#endif

void wait_for_sums() {
  memoryBarrier();
  WAIT();
}

// The sums begin as zeros: a strip or tile column may be missing.
void clear_sums() {
  for (uint c = 0u; c < CHUNK; ++c) {
    if (column_of(c) < COLUMNS) {
      for (uint i = lane; i < SIDE; i += WORKGROUP) {
        SET_FOUR(partial, rows_at[c] + i, vec4(0.0));
        SET_FOUR(partial, columns_at[c] + i, vec4(0.0));
      }
    }
  }
}

#ifdef EXCHANGE
#include "sym16_exchange.comp"
#else

// Four rows of half a tile: their sums, and what they add to the sums of the columns.
void quad(uint at, bool there, vec4 x_rows[CHUNK], Eight x[CHUNK], inout Eight sum[CHUNK], out vec4 rows[CHUNK]) {
  uvec4 words[4];
  for (uint r = 0u; r < 4u; ++r) words[r] = there ? WORDS(tiles, at + 2u * r) : uvec4(0u);
  for (uint r = 0u; r < 4u; ++r) {
    const Eight f = eight(words[r]);
    for (uint c = 0u; c < CHUNK; ++c) {
      rows[c][r] = dot8(f, x[c]);
      sum[c].low += f.low * x_rows[c][r];
      sum[c].high += f.high * x_rows[c][r];
    }
  }
}

// Each invocation's sums of rows side by side, then the parts of a row's sum.
const uint SHARES = WORKGROUP / ROW_PARTS;
const uint SLICES = min(8u, SHARES);
shared float share[QUADS * CHUNK * 4u][WORKGROUP];
shared float slice[8u * CHUNK][SLICES];

void join_rows(uint number, vec4 rows[QUADS][CHUNK]) {
  for (uint q = 0u; q < QUADS; ++q) {
    for (uint c = 0u; c < CHUNK; ++c) {
      for (uint r = 0u; r < 4u; ++r) share[(q * CHUNK + c) * 4u + r][lane] = rows[q][c][r];
    }
  }
  barrier();
  // Row o % 8 of column o / 8. Neighbours begin at different places, so that no two meet in a bank.
  for (uint k = lane; k < 8u * CHUNK * SLICES; k += WORKGROUP) {
    const uint o = k / SLICES;
    const uint q = o / 4u % 2u;
    const uint value = (q % QUADS * CHUNK + o / 8u) * 4u + o % 4u;
    const uint from = q / QUADS * SHARES + k % SLICES;
    float sum = 0.0;
    for (uint e = 0u; e < SHARES / SLICES; ++e) sum += share[value][from + (e + o) % (SHARES / SLICES) * SLICES];
    slice[o][k % SLICES] = sum;
  }
  barrier();
  for (uint k = lane; k < 2u * CHUNK; k += WORKGROUP) {
    vec4 sum = vec4(0.0);
    for (uint e = 0u; e < SLICES; ++e) {
      sum += vec4(slice[4u * k][e], slice[4u * k + 1u][e], slice[4u * k + 2u][e], slice[4u * k + 3u][e]);
    }
    if (column_of(k / 2u) < COLUMNS) add_four(rows_at[0] + k / 2u * SIDE + 2u * number + k % 2u, sum);
  }
}

#define X_OF_ROWS(c, q) FOUR(xs, x_column[c] + x_at + own_part() + q)
// Not a loop, which the driver would not unroll.
#define ROWS_OF_QUAD(q)                                                                                            \
  {                                                                                                                \
    vec4 x_rows[CHUNK];                                                                                            \
    for (uint c = 0u; c < CHUNK; ++c) x_rows[c] = X_OF_ROWS(c, q);                                                 \
    quad(tile * TILE_WORDS + 8u * (own_part() + q) + own_half(), there, x_rows, x, sum, rows[q]);                  \
  }

// The tile columns from `first` on, one for each two invocations of a part, down all strips.
void go_down(uint first, uint count) {
  const uint j = first + own_tile();
  const uvec2 bit = j < 32u ? uvec2(1u << j, 0u) : uvec2(0u, j < 64u ? 1u << (j - 32u) : 0u);
  const uvec2 before = j < 32u ? uvec2(bit.x - 1u, 0u) : uvec2(~0u, bit.y - 1u);
  const uint at = block_column * SIDE + 4u * j + 2u * own_half();
  Eight x[CHUNK];
  Eight sum[CHUNK];
  for (uint c = 0u; c < CHUNK; ++c) {
    const bool inside = at < a.vector_stride / 4u;
    x[c] = Eight(inside ? FOUR(xs, x_column[c] + at) : vec4(0.0), inside ? FOUR(xs, x_column[c] + at + 1u) : vec4(0.0));
    sum[c] = Eight(vec4(0.0), vec4(0.0));
  }
  for (uint t = 0u; t < count; ++t) {
    const uvec4 strip = strips[t];
    const bool there = (strip.zw & bit) != uvec2(0u);
    const uint tile = strip.y + uint(bitCount(strip.z & before.x) + bitCount(strip.w & before.y));
    vec4 rows[QUADS][CHUNK];
    const uint x_at = block_row * SIDE + 2u * strip.x;
    ROWS_OF_QUAD(0u)
#ifdef TEXEL
    ROWS_OF_QUAD(1u)
#endif
    join_rows(strip.x, rows);
  }
  for (uint part = 0u; part < ROW_PARTS; ++part) {
    wait_for_sums();
    if (own_part() == part && j < TILE_COLUMNS) {
      for (uint c = 0u; c < CHUNK; ++c) {
        const uint to = columns_at[c] + 4u * j + 2u * own_half();
        if (column_of(c) < COLUMNS) add_four(to, sum[c].low);
        if (column_of(c) < COLUMNS) add_four(to + 1u, sum[c].high);
      }
    }
  }
  wait_for_sums();
}

#endif

void main() {
  const uvec4 head = WORDS(index, gl_WorkGroupID.y);
  block_row = head.x;
  block_column = head.y;
  for (uint c = 0u; c < CHUNK; ++c) {
    x_column[c] = min(column_of(c), COLUMNS - 1u) * (a.vector_stride / 4u);
    rows_at[c] = slot(block_row, block_column, c);
    columns_at[c] = slot(block_column, block_row, c);
  }
#ifdef EXCHANGE
  // A group has a block: the condition only keeps the compiler from leaving the reads out.
  const uint seen = touch_tiles(head.z, head.w);
  if (a.blocks == 0u) block_row = seen;
#endif
  list_strips(head.z, head.w - head.z);
  clear_sums();
  wait_for_sums();
  const uint count = head.w - head.z;
  for (uint first = 0u; first < TILE_COLUMNS && count > 0u; first += TILES) go_down(first, count);
}

#else
#include "blocks.comp"

INPUT_FOURS(0, partial)
INPUT(1, t)
VECTOR(2, y)

// By fours, and four parts of a sum at once: their loops stay far below lavapipe's limit.
void main() {
  const uint side = a.option / 4u;
  FOR_EACH_ITEM {
    for (uint i = begin + 4u * gl_LocalInvocationIndex; i < end; i += 4u * WORKGROUP) {
      const uint k = i - column * a.vector_stride;
      const uint first = (k / a.option * a.slot * a.columns + column) * side + k % a.option / 4u;
      vec4 sum = vec4(0.0);
      for (uint j = 0u; j < a.slot; j += 4u) {
        for (uint u = 0u; u < 4u; ++u) {
          if (j + u < a.slot) sum += FOUR(partial, first + (j + u) * a.columns * side);
        }
      }
      for (uint u = 0u; u < 4u && i + u < end; ++u) y[i + u] = t[k + u] * sum[u];
    }
  }
}
#endif
