// sym16 where a work-group is one subgroup of eight that exchanges values: lavapipe, whose prices decide.
//  - Memory that is not read in order is waited for: the block is read once as it lies before its tile columns are gone down.
//  - An `if` does not skip its body: the strips that have a tile in the four tile columns are listed.
//  - Barriers keep all variables in memory; a single subgroup does without.
//  - So do arrays: the columns of x are written out, by macros.

#if CHUNK > 1
#define SECOND(statement) statement
#else
#define SECOND(statement)
#endif
#if CHUNK > 2
#define THIRD(statement) statement
#define THIRD_SUM sum2
#else
#define THIRD(statement)
#define THIRD_SUM vec4(0.0)
#endif

// In the row's fours invocation l = 2 c + q holds column c, quad q.
uint lane_of(uint c, uint q) { return 2u * c + q; }
bool holds_four() { return lane / 2u < CHUNK && column_of(lane / 2u) < COLUMNS; }

// Half of the sums goes with each exchange: between columns c and c + 2, then c and c + 1, then the quads.
vec4 halve(vec4 low, vec4 high, uint distance) {
  const bool upper = (lane & distance) != 0u;
  return (upper ? high : low) + subgroupShuffleXor(upper ? low : high, distance);
}

// Reads the block's tiles in their order, 64 bytes an invocation, so that they come into the cache as fast as memory gives.
uint touch_tiles(uint first, uint end) {
  const uint begins = 4u * a.blocks + a.strips;
  const uint last = WORD(index, begins + end) * TILE_WORDS;
  uint seen = 0u;
  uint k = WORD(index, begins + first) * TILE_WORDS + 4u * lane;
  for (; k < last; k += 128u) {
    for (uint u = 0u; u < 4u; ++u) seen |= WORDS(tiles, min(k + 32u * u, last - 1u)).x;
  }
  return seen;
}

// The strips with a tile in the four tile columns: its first tile counted from the block's, its number, which of the four.
shared uint steps[MOST_STRIPS];

// How many; one without tiles where there is none, since the loops run once.
uint list_steps(uint first, uint count, uint first_tile) {
  const uint place = first % 32u;
  const uvec2 before = first < 32u ? uvec2((1u << place) - 1u, 0u) : uvec2(~0u, (1u << place) - 1u);
  uint listed = 0u;
  uint t = 0u;
  do {
    const uvec4 strip = strips[min(t + lane, count - 1u)];
    const uint four = t + lane < count ? (first < 32u ? strip.z : strip.w) >> place & 15u : 0u;
    const uint tile = strip.y - first_tile + uint(bitCount(strip.z & before.x) + bitCount(strip.w & before.y));
    const uint all = subgroupOr(four != 0u ? 1u << lane : 0u);
    if (four != 0u) steps[listed + uint(bitCount(all & ((1u << lane) - 1u)))] = tile << 11u | strip.x << 4u | four;
    listed += uint(bitCount(all));
    t += 8u;
  } while (t < count);
  if (listed == 0u && lane == 0u) steps[0] = strips[0].x << 4u;
  WAIT();
  return max(listed, 1u);
}

// The invocation's eight columns: x and their sums.
#define BEGIN_COLUMN(c)                                                                \
  const vec4 x_low##c = inside ? FOUR(xs, x_column[c] + at) : vec4(0.0);               \
  const vec4 x_high##c = inside ? FOUR(xs, x_column[c] + at + 1u) : vec4(0.0);         \
  vec4 low##c = vec4(0.0), high##c = vec4(0.0);
#define STORE_COLUMN(c)                                                                \
  if (column_of(c) < COLUMNS && j < TILE_COLUMNS) {                                    \
    add_four(columns_at[c] + 4u * j + 2u * own_half(), low##c);                        \
    add_four(columns_at[c] + 4u * j + 2u * own_half() + 1u, high##c);                  \
  }

// Two columns of four rows, p and q: what they add to the rows' sums, and the rows to theirs.
#define ADD_PAIR(c, part, k, l)                   \
  sum##c += p * x_##part##c.k + q * x_##part##c.l; \
  part##c.k += dot(p, x##c);                      \
  part##c.l += dot(q, x##c);
#define ADD_WORD(word, part, k, l)                                                                        \
  {                                                                                                       \
    const vec2 r0 = unpackHalf2x16(w0.word), r1 = unpackHalf2x16(w1.word);                                \
    const vec2 r2 = unpackHalf2x16(w2.word), r3 = unpackHalf2x16(w3.word);                                \
    const vec4 p = vec4(r0.x, r1.x, r2.x, r3.x), q = vec4(r0.y, r1.y, r2.y, r3.y);                        \
    ADD_PAIR(0, part, k, l) SECOND(ADD_PAIR(1, part, k, l)) THIRD(ADD_PAIR(2, part, k, l))                \
  }
#define BEGIN_ROWS(c, quad) const vec4 x##c = subgroupShuffle(x_rows, lane_of(c, quad)); vec4 sum##c = vec4(0.0);
#define ADD_QUAD(quad)                                                                                    \
  {                                                                                                       \
    BEGIN_ROWS(0, quad) SECOND(BEGIN_ROWS(1, quad)) THIRD(BEGIN_ROWS(2, quad))                            \
    const uint at = tile + 8u * quad;                                                                     \
    const uvec4 w0 = WORDS(tiles, at) & there, w1 = WORDS(tiles, at + 2u) & there;                        \
    const uvec4 w2 = WORDS(tiles, at + 4u) & there, w3 = WORDS(tiles, at + 6u) & there;                   \
    ADD_WORD(x, low, x, y) ADD_WORD(y, low, z, w) ADD_WORD(z, high, x, y) ADD_WORD(w, high, z, w)         \
    vec4 odd = vec4(0.0);                                                                                 \
    SECOND(odd = halve(sum1, vec4(0.0), 4u);)                                                             \
    rows[quad] = halve(halve(sum0, THIRD_SUM, 4u), odd, 2u);                                              \
  }

// Four tile columns from `first` on, down the strips that have one of them.
void go_down(uint first, uint count) {
  const uint j = first + own_tile();
  const uint at = block_column * SIDE + 4u * j + 2u * own_half();
  const bool inside = at < a.vector_stride / 4u;
  BEGIN_COLUMN(0) SECOND(BEGIN_COLUMN(1)) THIRD(BEGIN_COLUMN(2))
  const uint begin = strips[0].y;
  const uint end = list_steps(first, count, begin);
  const uint own_bit = 1u << own_tile();
  const uint own_x = x_column[min(lane / 2u, CHUNK - 1u)] + block_row * SIDE + lane % 2u;
  const uint own_sum = rows_at[0] + lane / 2u * SIDE + lane % 2u;
  uint t = 0u;
  do {  // llvmpipe runs a loop whose condition stands first once more, masked
    const uint next = steps[min(t + lane, end - 1u)];  // eight at once: it reads shared memory lane by lane
    const uint last = min(t + 8u, end);
    do {
      const uint step = subgroupShuffle(next, t % 8u);
      const uint number = step >> 4u & 127u;
      const uint there = (step & own_bit) != 0u ? ~0u : 0u;  // where not, the strip's first of the four is read
      const uint before = uint(bitCount(step & (own_bit - 1u))) & there;
      const uint tile = (begin + (step >> 11u) + before) * TILE_WORDS + own_half();
      const vec4 x_rows = FOUR(xs, own_x + 2u * number);
      vec4 rows[2];
      ADD_QUAD(0u)
      ADD_QUAD(1u)
      const vec4 sum = halve(rows[0], rows[1], 1u);
      if (holds_four()) add_four(own_sum + 2u * number, sum);
    } while (++t < last);
  } while (t < end);
  STORE_COLUMN(0) SECOND(STORE_COLUMN(1)) THIRD(STORE_COLUMN(2))
  wait_for_sums();
}
