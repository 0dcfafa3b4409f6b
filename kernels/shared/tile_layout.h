// Where the assembly kernels keep what they tell each other about a batch of tiles: kernels/README.md.

// work: counters, then sections of one word for each pair, then a float for each row of each tile.
#define COUNTER_LISTS 0u       // of middle, near and straddling pairs
#define COUNTER_CHUNKS 3u      // of rays: of the pilot, then (4) of what follows
#define COUNTER_CUTS 5u        // pairs cut into pieces
#define COUNTER_CONSIDERED 6u  // pairs that face each other
#define COUNTER_ANALYTIC 7u    // of them by the contour form
#define COUNTER_RAYS 8u        // traced
#define COUNTERS 16u
#define SECTION_S 0u       // float
#define SECTION_STATE 1u   // kind, rays of the pilot, what followed
#define SECTION_HIDDEN 2u  // floats: weight of the rays that ended early, of all, squares of all weights
#define SECTION_TOTAL 3u
#define SECTION_SQUARES 4u  // in the end: the variance of the hidden share
#define SECTION_TRACED 5u   // rays
#define SECTION_SHARE 6u    // float: hidden / total
#define SECTION_PILOT 7u    // the share that the pilot found
#define SECTION_CHUNK 8u    // the first of its chunks of rays, or the number of its cut
#define SECTION_LISTS 2u    // three lists of pairs, before the sections are used for the rays
#define SECTIONS 9u

#define STATE_KIND 7u
#define STATE_PILOT_SHIFT 3u
#define STATE_PILOT 8191u  // assembly::most_pilot
#define STATE_MORE 65536u
#define STATE_CUT 131072u

// extra: chunks of rays, then cuts of pairs into pieces.
#define CHUNK_RAYS 8u
#define CHUNK_WORDS 7u  // pair, number of the first ray, how many | piece << 16, hidden, total, squares, traced
#define CUT_PIECES 64u
#define CUT_WORDS 196u  // pair, 3 spare, then S, first chunk and number of rays of each piece

FUNCTION uint in_section(TILE_PARAMETERS uint section, uint pair) {
  return COUNTERS + section * (args.tiles * TILE_PAIRS) + pair;
}
FUNCTION uint word_of(TILE_PARAMETERS uint section, uint pair) {
  return work[in_section(TILE section, pair)];
}
FUNCTION float float_in(TILE_PARAMETERS uint section, uint pair) {
  return float_of_bits(work[in_section(TILE section, pair)]);
}
/// Word `place` of the 32 that a tile has behind the sections: 0, whether any share is not 0, and 1, not 1; then a float
/// for each row.
FUNCTION uint of_tile(TILE_PARAMETERS uint pair, uint place) {
  return COUNTERS + SECTIONS * (args.tiles * TILE_PAIRS) + pair / TILE_PAIRS * BLOCK_PATCHES + place;
}
FUNCTION uint row_patch(TILE_PARAMETERS uint pair) {
  return (TILE_WORDS(pair / TILE_PAIRS).x & ~TRACED_BIT) * BLOCK_PATCHES + pair % TILE_PAIRS / BLOCK_PATCHES;
}
FUNCTION uint column_patch(TILE_PARAMETERS uint pair) {
  return TILE_WORDS(pair / TILE_PAIRS).y * BLOCK_PATCHES + pair % BLOCK_PATCHES;
}
FUNCTION bool is_traced(TILE_PARAMETERS uint pair) {
  return (TILE_WORDS(pair / TILE_PAIRS).x & TRACED_BIT) != 0u;
}
FUNCTION float area_at(TILE_PARAMETERS uint i) {
  return float_of_bits(PATCH_WORDS(i * 8u + 2u).w);
}

/// The larger of the pair's form factors.
FUNCTION float factor_of(TILE_PARAMETERS uint pair) {
  const float area_i = area_at(TILE row_patch(TILE pair)), area_j = area_at(TILE column_patch(TILE pair));
  return float_in(TILE SECTION_S, pair) / smaller(area_i, area_j);
}
/// RayBudget: rays of the pilot, and all rays of a mixed pair.
FUNCTION uint pilot_rays(TILE_PARAMETERS float factor) {
  const float wanted = args.pilot_per_factor * factor;
  if (wanted >= TO_FLOAT(args.most_in_pilot)) return args.most_in_pilot;
  const uint whole = TO_UINT(wanted);
  return wanted <= 1.0f ? 1u : TO_FLOAT(whole) < wanted ? whole + 1u : whole;
}
FUNCTION uint all_rays(TILE_PARAMETERS float factor) {
  return TO_UINT(smaller(args.rays_per_factor * factor, TO_FLOAT(args.most)));
}

FUNCTION uint chunks_of(uint rays) {
  return (rays + CHUNK_RAYS - 1u) / CHUNK_RAYS;
}
FUNCTION uint chunk_at(uint chunk) {
  return chunk * CHUNK_WORDS;
}
FUNCTION uint cut_at(TILE_PARAMETERS uint cut) {
  return args.chunks * CHUNK_WORDS + cut * CUT_WORDS;
}

/// Lists rays number first .. end - 1 of a pair or piece as chunks; returns the first one's number. Where the list is
/// full the counter alone goes on, and the host does the batch again in parts.
FUNCTION uint list_rays(TILE_PARAMETERS uint counter, uint pair, uint piece, uint first, uint end) {
  const uint count = chunks_of(end - first), base = ADD_TO(work, counter, count);
  for (uint k = 0u; k < count && base + k < args.chunks; ++k) {
    const uint at = chunk_at(base + k), from = first + k * CHUNK_RAYS;
    extra[at] = pair;
    extra[at + 1u] = from;
    extra[at + 2u] = (end - from < CHUNK_RAYS ? end - from : CHUNK_RAYS) | (piece << 16);
  }
  return base;
}

/// Of the rays of a pair: the weight that ended early, all of it, and how many were traced.
STRUCT(RaySums) {
  float hidden, total, squares;
  uint traced;
};

FUNCTION RaySums no_rays() {
  RaySums sums;
  sums.hidden = 0.0f;
  sums.total = 0.0f;
  sums.squares = 0.0f;
  sums.traced = 0u;
  return sums;
}

/// The sums over consecutive chunks.
FUNCTION RaySums sums_of_chunks(TILE_PARAMETERS uint first, uint count) {
  RaySums sums = no_rays();
  for (uint k = 0u; k < count; ++k) {
    const uint at = chunk_at(first + k);
    sums.hidden += float_of_bits(extra[at + 3u]);
    sums.total += float_of_bits(extra[at + 4u]);
    sums.squares += float_of_bits(extra[at + 5u]);
    sums.traced += extra[at + 6u];
  }
  return sums;
}
FUNCTION float hidden_share(RaySums sums) {
  return sums.total > 0.0f ? sums.hidden / sums.total : 0.0f;
}
