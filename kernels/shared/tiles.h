// The steps of the assembly, one function for an item of each kernel. kernels/README.md has the reference loops.

/// An item is a column of a tile: what its 32 pairs are, and S of the far ones; the others that need S are listed.
FUNCTION void tile_kinds_item(TILE_PARAMETERS uint item) {
  const uvec4 tile = TILE_WORDS(item / BLOCK_PATCHES);
  const uint b = item % BLOCK_PATCHES, first_row = (tile.x & ~TRACED_BIT) * BLOCK_PATCHES;
  const uint j = tile.y * BLOCK_PATCHES + b, rows = ((tile.w >> b) & 1u) != 0u ? tile.z : 0u;
  const Patch y = patch_at(TILE j);
  uint considered = 0u, analytic = 0u;
  for (uint r = 0u; r < BLOCK_PATCHES; ++r) {
    const uint i = first_row + r, pair = item / BLOCK_PATCHES * TILE_PAIRS + r * BLOCK_PATCHES + b;
    uint kind = NONE;
    float s = 0.0f;
    if (((rows >> r) & 1u) != 0u && i < j) {
      const Patch x = patch_at(TILE i);
      const PairResult result = classified(x, y, args.three2, args.six2);
      kind = result.kind;
      considered += kind != NONE ? 1u : 0u;
      analytic += kind >= NEAR ? 1u : 0u;
      if (kind == FAR) {
        s = result.s > NEGLIGIBLE * smaller(x.area, y.area) ? result.s : 0.0f;
        if (s == 0.0f) kind = NONE;
      } else if (kind != NONE) {
        const uint list = kind - MIDDLE, place = ADD_TO(work, COUNTER_LISTS + list, 1u);
        work[in_section(TILE SECTION_LISTS + list, place)] = pair;
      }
    }
    work[in_section(TILE SECTION_S, pair)] = bits_of_float(s);
    work[in_section(TILE SECTION_STATE, pair)] = kind;
  }
  work[of_tile(TILE item / BLOCK_PATCHES * TILE_PAIRS, b)] = 0u;
  if (considered > 0u) ADD_TO(work, COUNTER_CONSIDERED, considered);
  if (analytic > 0u) ADD_TO(work, COUNTER_ANALYTIC, analytic);
}

/// An item is an entry of list `option`: S of a middle, near or straddling pair.
FUNCTION void tile_special_item(TILE_PARAMETERS uint item) {
  const uint pair = word_of(TILE SECTION_LISTS + args.option, item), kind = MIDDLE + args.option;
  const Patch x = patch_at(TILE row_patch(TILE pair)), y = patch_at(TILE column_patch(TILE pair));
  const vec3 d = centroids_between(x, y);
  const Polygon a = visible_part(x, y, -d, kind), b = visible_part(y, x, d, kind);
  float s = 0.0f;
  if (a.size > 0u && b.size > 0u) s = unoccluded(a, b, x, y, d, kind, args.three2, args.six2);
  const bool counts = s > NEGLIGIBLE * smaller(x.area, y.area);
  work[in_section(TILE SECTION_S, pair)] = bits_of_float(counts ? s : 0.0f);
  if (!counts) work[in_section(TILE SECTION_STATE, pair)] = NONE;
}

/// An item is a pair: how many rays it gets first; those beyond a chunk are listed.
FUNCTION void tile_pilot_item(TILE_PARAMETERS uint pair) {
  const uint kind = word_of(TILE SECTION_STATE, pair);
  if (kind == NONE || !is_traced(TILE pair)) return;
  const uint rays = pilot_rays(TILE factor_of(TILE pair));
  work[in_section(TILE SECTION_STATE, pair)] = kind | (rays << STATE_PILOT_SHIFT);
  if (rays > CHUNK_RAYS) {
    work[in_section(TILE SECTION_CHUNK, pair)] = list_rays(TILE COUNTER_CHUNKS, pair, 0u, CHUNK_RAYS, rays);
  }
}

/// The variance of a hidden share that is a mean over rays: the unbiased p (1 - p) / (n - 1), n being their effective
/// number; of a single ray `spread`, an estimate of v (1 - v). host/formfactor/pair_error.cpp.
FUNCTION float variance_of(RaySums sums, float spread) {
  if (!(sums.total > 0.0f)) return 0.0f;
  const float p = hidden_share(sums), n = sums.total * sums.total / sums.squares;
  return n > 1.5f ? larger(0.0f, p * (1.0f - p)) / (n - 1.0f) : spread / n;
}

/// v (1 - v) of a pair with a single ray: half the mean square difference from the pilots of the pairs beside it.
FUNCTION float spread_beside(TILE_PARAMETERS uint pair) {
  const uint row = pair % TILE_PAIRS / BLOCK_PATCHES, column = pair % BLOCK_PATCHES;
  const float own = float_in(TILE SECTION_PILOT, pair);
  float squares = 0.0f, count = 0.0f;
  for (uint k = 0u; k < 4u; ++k) {
    const bool inside = k == 0u   ? row > 0u
                        : k == 1u ? row + 1u < BLOCK_PATCHES
                        : k == 2u ? column > 0u
                                  : column + 1u < BLOCK_PATCHES;
    if (!inside) continue;
    const uint other = k == 0u ? pair - BLOCK_PATCHES : k == 1u ? pair + BLOCK_PATCHES : k == 2u ? pair - 1u : pair + 1u;
    if ((word_of(TILE SECTION_STATE, other) & STATE_KIND) == NONE) continue;
    const float difference = float_in(TILE SECTION_PILOT, other) - own;
    squares += difference * difference;
    count += 1.0f;
  }
  return count > 0.0f ? 0.5f * squares / count : 0.16666667f;
}

/// The chunk sums of a pair's piece, and its S.
FUNCTION RaySums sums_of_piece(TILE_PARAMETERS uint cut, uint piece) {
  const uint entry = cut_at(TILE cut) + 4u + 3u * piece;
  return sums_of_chunks(TILE extra[entry + 1u], chunks_of(extra[entry + 2u]));
}
FUNCTION float s_of_piece(TILE_PARAMETERS uint cut, uint piece) {
  return float_of_bits(extra[cut_at(TILE cut) + 4u + 3u * piece]);
}

/// What a pair's rays found in the end: its hidden share, the variance of that, and how many rays there were.
STRUCT(Found) {
  float share, variance;
  uint traced;
};

/// Of a pair in pieces, whose rays replace its own: means over the pieces weighted by their S.
FUNCTION Found found_by_pieces(TILE_PARAMETERS uint cut, uint traced) {
  Found found;
  found.traced = traced;
  float all = 0.0f, hidden = 0.0f;
  for (uint piece = 0u; piece < CUT_PIECES; ++piece) {
    const float s = s_of_piece(TILE cut, piece);
    if (!(s > 0.0f)) continue;
    const RaySums part = sums_of_piece(TILE cut, piece);
    all += s;
    hidden += s * hidden_share(part);
    found.traced += part.traced;
  }
  found.share = all > 0.0f ? hidden / all : 0.0f;
  found.variance = 0.0f;
  for (uint piece = 0u; piece < CUT_PIECES; ++piece) {
    const float s = s_of_piece(TILE cut, piece);
    if (!(s > 0.0f)) continue;
    const float part = s / all;
    found.variance +=
        part * part * variance_of(sums_of_piece(TILE cut, piece), found.share * (1.0f - found.share));
  }
  return found;
}

FUNCTION RaySums sums_of_pair(TILE_PARAMETERS uint pair) {
  RaySums sums;
  sums.hidden = float_in(TILE SECTION_HIDDEN, pair);
  sums.total = float_in(TILE SECTION_TOTAL, pair);
  sums.squares = float_in(TILE SECTION_SQUARES, pair);
  sums.traced = word_of(TILE SECTION_TRACED, pair);
  return sums;
}
FUNCTION RaySums with_chunks(TILE_PARAMETERS RaySums sums, uint first, uint count) {
  const RaySums more = sums_of_chunks(TILE first, count);
  RaySums all;
  all.hidden = sums.hidden + more.hidden;
  all.total = sums.total + more.total;
  all.squares = sums.squares + more.squares;
  all.traced = sums.traced + more.traced;
  return all;
}

/// Option 0, after the pilot: the hidden share that it found. Option 1, after all rays: the share and its variance.
FUNCTION void tile_shares_item(TILE_PARAMETERS uint pair) {
  const uint state = word_of(TILE SECTION_STATE, pair), pilot = (state >> STATE_PILOT_SHIFT) & STATE_PILOT;
  if (pilot == 0u) {
    work[in_section(TILE SECTION_SHARE, pair)] = 0u;
    work[in_section(TILE SECTION_PILOT, pair)] = 0u;
    work[in_section(TILE SECTION_SQUARES, pair)] = 0u;
    work[in_section(TILE SECTION_TRACED, pair)] = 0u;
    return;
  }
  RaySums sums = sums_of_pair(TILE pair);
  const uint at = word_of(TILE SECTION_CHUNK, pair);
  if (args.option == 0u) {
    if (pilot > CHUNK_RAYS) sums = with_chunks(TILE sums, at, chunks_of(pilot - CHUNK_RAYS));
    const float share = hidden_share(sums);
    work[in_section(TILE SECTION_HIDDEN, pair)] = bits_of_float(sums.hidden);
    work[in_section(TILE SECTION_TOTAL, pair)] = bits_of_float(sums.total);
    work[in_section(TILE SECTION_SQUARES, pair)] = bits_of_float(sums.squares);
    work[in_section(TILE SECTION_TRACED, pair)] = sums.traced;
    work[in_section(TILE SECTION_SHARE, pair)] = bits_of_float(share);
    work[in_section(TILE SECTION_PILOT, pair)] = bits_of_float(share);
    if (share > 0.0f) work[of_tile(TILE pair, 0u)] = 1u;
    if (share < 1.0f) work[of_tile(TILE pair, 1u)] = 1u;
    return;
  }
  Found found;
  if ((state & STATE_CUT) != 0u) {
    found = found_by_pieces(TILE at, sums.traced);
  } else {
    if ((state & STATE_MORE) != 0u) {
      sums = with_chunks(TILE sums, at, chunks_of(larger(all_rays(TILE factor_of(TILE pair)), args.fewest) - pilot));
    }
    found.share = hidden_share(sums);
    found.variance = variance_of(sums, pilot == 1u ? spread_beside(TILE pair) : 0.0f);
    found.traced = sums.traced;
  }
  const bool mixed = work[of_tile(TILE pair, 0u)] != 0u && work[of_tile(TILE pair, 1u)] != 0u;
  work[in_section(TILE SECTION_SHARE, pair)] = bits_of_float(found.share);
  work[in_section(TILE SECTION_SQUARES, pair)] = bits_of_float(mixed ? found.variance : 0.0f);
  work[in_section(TILE SECTION_TRACED, pair)] = found.traced;
}

/// Whether a pair with rays deserves more: its own shares or those of its neighbours in the tile are not all the same.
/// With few rays of its own only the neighbours are asked.
FUNCTION bool disagrees(TILE_PARAMETERS uint pair, uint pilot) {
  const float own = float_in(TILE SECTION_SHARE, pair);
  const bool asked = pilot >= 8u;
  if (asked && own > 0.0f && own < 1.0f) return true;
  float low = asked ? own : 1.0f, high = asked ? own : 0.0f;
  const uint row = pair % TILE_PAIRS / BLOCK_PATCHES, column = pair % BLOCK_PATCHES;
  for (uint k = 0u; k < 9u; ++k) {
    const uint r = row + k / 3u, c = column + k % 3u;  // one too many
    if (k == 4u || r == 0u || c == 0u || r > BLOCK_PATCHES || c > BLOCK_PATCHES) continue;
    const uint other = pair / TILE_PAIRS * TILE_PAIRS + (r - 1u) * BLOCK_PATCHES + (c - 1u);
    if ((word_of(TILE SECTION_STATE, other) & STATE_KIND) == NONE) continue;
    const float hidden = float_in(TILE SECTION_SHARE, other);
    low = smaller(low, hidden);
    high = larger(high, hidden);
  }
  return high > low;
}

/// An item is a pair: the rays that follow the pilot are listed, or the pair is cut.
FUNCTION void tile_mixed_item(TILE_PARAMETERS uint pair) {
  const uint state = word_of(TILE SECTION_STATE, pair), pilot = (state >> STATE_PILOT_SHIFT) & STATE_PILOT;
  if (pilot == 0u || !disagrees(TILE pair, pilot)) return;
  const float factor = factor_of(TILE pair);
  if (factor >= args.split_from && (state & STATE_KIND) != FAR) {
    const uint cut = ADD_TO(work, COUNTER_CUTS, 1u);
    work[in_section(TILE SECTION_CHUNK, pair)] = cut;
    work[in_section(TILE SECTION_STATE, pair)] = state | STATE_CUT;
    if (cut < args.cuts) extra[cut_at(TILE cut)] = pair;
    return;
  }
  const uint rays = larger(all_rays(TILE factor), args.fewest);
  if (rays <= pilot) return;
  work[in_section(TILE SECTION_CHUNK, pair)] = list_rays(TILE COUNTER_CHUNKS + 1u, pair, 0u, pilot, rays);
  work[in_section(TILE SECTION_STATE, pair)] = state | STATE_MORE;
}

/// An item is one of 64 places for a piece of a cut pair: its S; its rays are listed.
FUNCTION void tile_pieces_item(TILE_PARAMETERS uint item) {
  const uint cut = item / CUT_PIECES, piece = item % CUT_PIECES, pair = extra[cut_at(TILE cut)];
  const uint kind = word_of(TILE SECTION_STATE, pair) & STATE_KIND;
  const Patch x = patch_at(TILE row_patch(TILE pair)), y = patch_at(TILE column_patch(TILE pair));
  const vec3 d = centroids_between(x, y);
  const Polygon a = visible_part(x, y, -d, kind), b = visible_part(y, x, d, kind);
  const uint across = 4u * (b.size - 2u), ka = piece / across, kb = piece % across;
  float s = 0.0f;
  uint rays = 0u, chunk = 0u;
  if (ka < 4u * (a.size - 2u)) {
    const Polygon p = quarter_of(fan_of(a, ka / 4u), ka % 4u), q = quarter_of(fan_of(b, kb / 4u), kb % 4u);
    s = unoccluded(p, q, x, y, d, STRADDLE, args.three2, args.six2);
    if (s > 0.0f) {
      const float share = s / float_in(TILE SECTION_S, pair);
      rays = larger(TO_UINT(TO_FLOAT(all_rays(TILE factor_of(TILE pair))) * share), args.fewest);
      chunk = list_rays(TILE COUNTER_CHUNKS + 1u, pair, piece + 1u, 0u, rays);
    }
  }
  const uint entry = cut_at(TILE cut) + 4u + 3u * piece;
  extra[entry] = bits_of_float(s);
  extra[entry + 1u] = chunk;
  extra[entry + 2u] = rays;
}

/// An item is a row of a tile: S as far as it is visible, and what rays and quadrature add to the tile's variance,
/// Σ σ²(S) / (A_i A_j).
FUNCTION void tile_finish_item(TILE_PARAMETERS uint item) {
  float variance = 0.0f;
  uint rays = 0u;
  for (uint b = 0u; b < BLOCK_PATCHES; ++b) {
    const uint pair = item * BLOCK_PATCHES + b;
    const float s = float_in(TILE SECTION_S, pair), share = float_in(TILE SECTION_SHARE, pair);
    if (!(s > 0.0f)) continue;
    work[in_section(TILE SECTION_S, pair)] = bits_of_float(s * (1.0f - share));
    const uint kind = word_of(TILE SECTION_STATE, pair) & STATE_KIND;
    const float of_share = float_in(TILE SECTION_SQUARES, pair) +
                           (kind == FAR ? args.three_error2 : kind == MIDDLE ? args.six_error2 : 0.0f);
    const float area_i = area_at(TILE row_patch(TILE pair)), area_j = area_at(TILE column_patch(TILE pair));
    variance += of_share * ((s / area_i) * (s / area_j));
    rays += word_of(TILE SECTION_TRACED, pair);
  }
  work[of_tile(TILE item / BLOCK_PATCHES * TILE_PAIRS, item % BLOCK_PATCHES)] = bits_of_float(variance);
  if (rays > 0u) ADD_TO(work, COUNTER_RAYS, rays);
}
