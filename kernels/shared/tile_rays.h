// Samples on patches and the shadow rays between them: host/formfactor/sampling.h, operation by operation but for the
// origin, which is here the centroid of the row's patch.

#define STEP_U 3242174889u  // sampling::step2: from one other patch to the next
#define STEP_V 2447445415u
#define PIECE_U 0x9E3779B9u  // sampling::piece_step
#define PIECE_V 0x85EBCA6Bu

/// What rays start from or end on: a triangle, or a fan of two.
STRUCT(Facet) {
  vec3 corner, edge0, edge1, edge2;
  float share_of_first;
};

FUNCTION Facet facet_of(Polygon p) {
  Facet facet;
  facet.corner = p.a;
  facet.edge0 = p.b - p.a;
  facet.edge1 = p.c - p.a;
  facet.edge2 = p.d - p.a;
  facet.share_of_first = 1.0f;
  if (p.size == 4u) {
    const float first = area_of(fan_of(p, 0u)), second = area_of(fan_of(p, 1u));
    if (first + second > 0.0f) facet.share_of_first = first / (first + second);
  }
  return facet;
}

FUNCTION float unit_of(uint s) {
  return (TO_FLOAT(s >> 9) + 0.5f) * 1.1920929e-7f;
}

/// The square mapped to the facet: Heitz's low-distortion map for a triangle; the two of a fan take their shares of u.
FUNCTION vec3 point_on(Facet facet, uint su, uint sv) {
  const float share = facet.share_of_first;
  float u = unit_of(su), v = unit_of(sv);
  const bool in_first = share >= 1.0f || u < share;
  if (share < 1.0f) u = in_first ? u / share : (u - share) / (1.0f - share);
  const float x = v > u ? 0.5f * u : u - 0.5f * v, y = v > u ? v - 0.5f * u : 0.5f * v;
  return facet.corner + x * (in_first ? facet.edge0 : facet.edge1) + y * (in_first ? facet.edge1 : facet.edge2);
}

/// Rays number first .. first + count - 1 of a pair, or of piece 1, 2, ... of a pair that is cut.
FUNCTION RaySums rays_between(HIERARCHY_PARAMETERS TILE_PARAMETERS uint i, uint j, uint kind, uint first, uint count,
                              uint piece) {
  const Patch x = patch_at(TILE i), y = patch_at(TILE j);
  const vec3 d = centroids_between(x, y);
  Polygon a = visible_part(x, y, -d, kind), b = visible_part(y, x, d, kind);
  if (piece > 0u) {
    const uint across = 4u * (b.size - 2u), ka = (piece - 1u) / across, kb = (piece - 1u) % across;
    a = quarter_of(fan_of(a, ka / 4u), ka % 4u);
    b = quarter_of(fan_of(b, kb / 4u), kb % 4u);
  }
  const Facet from = facet_of(a), to = facet_of(b);
  const uvec4 word_i = PATCH_WORDS(i * 8u + 6u), word_j = PATCH_WORDS(j * 8u + 6u);
  const uint from_u = word_i.x + j * STEP_U + piece * PIECE_U, from_v = word_i.y + j * STEP_V + piece * PIECE_V;
  const uint to_u = word_j.z + i * STEP_U + piece * PIECE_U, to_v = word_j.w + i * STEP_V + piece * PIECE_V;
  RaySums sums;
  sums.hidden = 0.0f;
  sums.total = 0.0f;
  sums.traced = 0u;
  for (uint k = first; k < first + count; ++k) {
    const vec3 p = point_on(from, from_u + k * 3679390609u, from_v + k * 3152041523u);
    const vec3 q = point_on(to, to_u + k * 2700274807u, to_v + k * 2313257605u);
    const vec3 between = d + (q - p);
    const float over_x = dot3(x.normal, between), over_y = -dot3(y.normal, between);
    if (!(over_x > 0.0f && over_y > 0.0f)) continue;  // on the other's plane, to rounding: no weight
    const vec3 start = smaller(args.lift, 0.25f * over_x) * x.normal, end = smaller(args.lift, 0.25f * over_y) * y.normal;
    const vec3 origin = x.hi + (x.lo + (p + start)), direction = between + (end - start);
    const float r2 = dot3(between, between);
    const float weight = kind == FAR ? 1.0f : (over_x / r2) * (over_y / r2);
    ++sums.traced;
    sums.total += weight;
    if (occluded(HIERARCHY origin, direction, 0.0f, 1.0f)) sums.hidden += weight;
  }
  return sums;
}

/// An item is a pair, whose first chunk of the pilot it is (option 0), or a chunk of the list (1).
FUNCTION void tile_rays_item(HIERARCHY_PARAMETERS TILE_PARAMETERS uint item) {
  const bool listed = args.option != 0u;
  const uint at = chunk_at(item), pair = listed ? extra[at] : item, state = word_of(TILE SECTION_STATE, pair);
  const uint pilot = (state >> STATE_PILOT_SHIFT) & STATE_PILOT;
  if (pilot == 0u) return;
  const uint first = listed ? extra[at + 1u] : 0u, packed = listed ? extra[at + 2u] : smaller(pilot, CHUNK_RAYS);
  const RaySums sums = rays_between(HIERARCHY TILE row_patch(TILE pair), column_patch(TILE pair), state & STATE_KIND,
                                    first, packed & 65535u, packed >> 16);
  if (listed) {
    extra[at + 3u] = bits_of_float(sums.hidden);
    extra[at + 4u] = bits_of_float(sums.total);
    extra[at + 5u] = sums.traced;
  } else {
    work[in_section(TILE SECTION_HIDDEN, pair)] = bits_of_float(sums.hidden);
    work[in_section(TILE SECTION_TOTAL, pair)] = bits_of_float(sums.total);
    work[in_section(TILE SECTION_TRACED, pair)] = sums.traced;
  }
}
