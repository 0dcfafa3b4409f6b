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

/// What the rays of a pair have in common.
STRUCT(RaySource) {
  Facet from, to;
  vec3 hi, lo, between, normal_from, normal_to;
  uint from_u, from_v, to_u, to_v;
  bool weighted;
};

/// Of a pair, or of piece 1, 2, ... of a pair that is cut.
FUNCTION RaySource source_of(TILE_PARAMETERS uint i, uint j, uint kind, uint piece) {
  const Patch x = patch_at(TILE i), y = patch_at(TILE j);
  const vec3 d = centroids_between(x, y);
  Polygon a = visible_part(x, y, -d, kind), b = visible_part(y, x, d, kind);
  if (piece > 0u) {
    const uint across = 4u * (b.size - 2u), ka = (piece - 1u) / across, kb = (piece - 1u) % across;
    a = quarter_of(fan_of(a, ka / 4u), ka % 4u);
    b = quarter_of(fan_of(b, kb / 4u), kb % 4u);
  }
  const uvec4 word_i = PATCH_WORDS(i * 8u + 6u), word_j = PATCH_WORDS(j * 8u + 6u);
  RaySource source;
  source.from = facet_of(a);
  source.to = facet_of(b);
  source.hi = x.hi;
  source.lo = x.lo;
  source.between = d;
  source.normal_from = x.normal;
  source.normal_to = y.normal;
  source.from_u = word_i.x + j * STEP_U + piece * PIECE_U;
  source.from_v = word_i.y + j * STEP_V + piece * PIECE_V;
  source.to_u = word_j.z + i * STEP_U + piece * PIECE_U;
  source.to_v = word_j.w + i * STEP_V + piece * PIECE_V;
  source.weighted = kind != FAR;
  return source;
}

/// A shadow ray origin + t direction, 0 < t < 1, and the share of S that it stands for, without a factor that all rays
/// of its pair have in common. Weight 0: on the other's plane, to rounding; not to be traced.
STRUCT(ShadowRay) {
  vec3 origin, direction;
  float weight;
};

FUNCTION ShadowRay ray_of(TILE_PARAMETERS RaySource source, uint k) {
  const vec3 p = point_on(source.from, source.from_u + k * 3679390609u, source.from_v + k * 3152041523u);
  const vec3 q = point_on(source.to, source.to_u + k * 2700274807u, source.to_v + k * 2313257605u);
  const vec3 between = source.between + (q - p);
  const float over_from = dot3(source.normal_from, between), over_to = -dot3(source.normal_to, between);
  const vec3 start = smaller(args.lift, 0.25f * over_from) * source.normal_from,
             end = smaller(args.lift, 0.25f * over_to) * source.normal_to;
  const float shortest = 128.0f * args.lift;  // sampling::shortest_in_lifts
  const float inverse = 1.0f / larger(dot3(between, between), shortest * shortest);
  ShadowRay ray;
  ray.origin = source.hi + (source.lo + (p + start));
  ray.direction = between + (end - start);
  const bool faces = over_from > 0.0f && over_to > 0.0f;
  ray.weight = !faces ? 0.0f : source.weighted ? (over_from * inverse) * (over_to * inverse) : 1.0f;
  return ray;
}

/// An item of tile_rays is a pair, whose first chunk of the pilot it is (option 0), or a chunk of the list (1): rays
/// number first .. first + count - 1 of a pair, or of a piece of it. count 0: nothing to do.
STRUCT(RayItem) {
  uint pair, state, first, count, piece;
};
FUNCTION RayItem ray_item(TILE_PARAMETERS uint item) {
  const bool listed = args.option != 0u;
  const uint at = chunk_at(item);
  RayItem rays;
  rays.pair = listed ? extra[at] : item;
  rays.state = word_of(TILE SECTION_STATE, rays.pair);
  const uint pilot = (rays.state >> STATE_PILOT_SHIFT) & STATE_PILOT;
  const uint packed = listed ? extra[at + 2u] : smaller(pilot, CHUNK_RAYS);
  rays.first = listed ? extra[at + 1u] : 0u;
  rays.count = pilot == 0u ? 0u : packed & 65535u;
  rays.piece = packed >> 16;
  return rays;
}
FUNCTION RaySource source_of_item(TILE_PARAMETERS RayItem rays) {
  return source_of(TILE row_patch(TILE rays.pair), column_patch(TILE rays.pair), rays.state & STATE_KIND, rays.piece);
}
FUNCTION void store_hidden(TILE_PARAMETERS uint item, float hidden) {
  if (args.option != 0u) {
    extra[chunk_at(item) + 3u] = bits_of_float(hidden);
  } else {
    work[in_section(TILE SECTION_HIDDEN, item)] = bits_of_float(hidden);
  }
}
FUNCTION void store_totals(TILE_PARAMETERS uint item, RaySums sums) {
  if (args.option != 0u) {
    const uint at = chunk_at(item);
    extra[at + 4u] = bits_of_float(sums.total);
    extra[at + 5u] = bits_of_float(sums.squares);
    extra[at + 6u] = sums.traced;
  } else {
    work[in_section(TILE SECTION_TOTAL, item)] = bits_of_float(sums.total);
    work[in_section(TILE SECTION_SQUARES, item)] = bits_of_float(sums.squares);
    work[in_section(TILE SECTION_TRACED, item)] = sums.traced;
  }
}

#if PACKET == 1

FUNCTION void tile_rays_item(HIERARCHY_PARAMETERS TILE_PARAMETERS uint item) {
  const RayItem rays = ray_item(TILE item);
  if (rays.count == 0u) return;
  const RaySource source = source_of_item(TILE rays);
  RaySums sums = no_rays();
  for (uint k = rays.first; k < rays.first + rays.count; ++k) {
    const ShadowRay ray = ray_of(TILE source, k);
    if (!(ray.weight > 0.0f)) continue;
    ++sums.traced;
    sums.total += ray.weight;
    sums.squares += ray.weight * ray.weight;
    if (occluded(HIERARCHY ray.origin, ray.direction, 0.0f, 1.0f)) sums.hidden += ray.weight;
  }
  store_hidden(TILE item, sums.hidden);
  store_totals(TILE item, sums);
}

#else

/// Rays of successive items that an invocation traces together. The items' sums begin at 0 and are added up in memory:
/// of an item the rays always come in order.
STRUCT(Pending) {
  RayBatch batch;
  uint item[PACKET];
  float weight[PACKET];
  uint count;
};

FUNCTION void trace_pending(HIERARCHY_PARAMETERS TILE_PARAMETERS Pending *pending) {
  for (uint k = pending->count; k < PACKET; ++k) PUT_NO_RAY(pending->batch, k);
  const uint found = occluded_batch(HIERARCHY pending->batch);
  for (uint k = 0u; k < pending->count; ++k) {
    if (((found >> k) & 1u) == 0u) continue;
    const uint item = pending->item[k];
    if (args.option != 0u) {
      extra[chunk_at(item) + 3u] = bits_of_float(float_of_bits(extra[chunk_at(item) + 3u]) + pending->weight[k]);
    } else {
      const uint at = in_section(TILE SECTION_HIDDEN, item);
      work[at] = bits_of_float(float_of_bits(work[at]) + pending->weight[k]);
    }
  }
  pending->count = 0u;
}

/// Items [begin, end).
FUNCTION void tile_rays_items(HIERARCHY_PARAMETERS TILE_PARAMETERS uint begin, uint end) {
  Pending pending;
  pending.count = 0u;
  for (uint item = begin; item < end; ++item) {
    const RayItem rays = ray_item(TILE item);
    if (rays.count == 0u) continue;
    const RaySource source = source_of_item(TILE rays);
    RaySums sums = no_rays();
    store_hidden(TILE item, 0.0f);
    for (uint k = rays.first; k < rays.first + rays.count; ++k) {
      const ShadowRay ray = ray_of(TILE source, k);
      if (!(ray.weight > 0.0f)) continue;
      ++sums.traced;
      sums.total += ray.weight;
      sums.squares += ray.weight * ray.weight;
      pending.item[pending.count] = item;
      pending.weight[pending.count] = ray.weight;
      PUT_RAY(pending.batch, pending.count, ray.origin, 0.0f, ray.direction, 1.0f);
      ++pending.count;
      if (pending.count == PACKET) trace_pending(HIERARCHY TILE &pending);
    }
    store_totals(TILE item, sums);
  }
  if (pending.count > 0u) trace_pending(HIERARCHY TILE &pending);
}

#endif
