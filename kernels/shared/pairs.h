// The patches of a pair, as they lie in the buffers of the assembly kernels, and their S without occlusion.
// kernels/README.md, "tile_kinds ... tile_store", is the contract.

// Kinds of pairs: simd::PairKind of the host.
#define NONE 0u      // one lies behind or in the plane of the other: S = 0
#define FAR 1u       // 3 x 3 points
#define MIDDLE 2u    // 6 x 6 points
#define NEAR 3u      // the contour form
#define STRADDLE 4u  // one is cut by the plane of the other

#define BLOCK_PATCHES 32u
#define TILE_PAIRS 1024u
#define TRACED_BIT 0x80000000u  // of a tile's row block: something lies between the two blocks
#define NEGLIGIBLE 1e-12f       // factors below this are as good as none
#define PLANE_ROUNDING 4e-7f    // of a corner's distance from a plane, as a share of the distance between the two

/// Corners and normal relative to the centroid, which is hi + lo.
STRUCT(Patch) {
  vec3 hi, lo, e0, e1, e2, normal;
  float radius, tolerance, area;
};

FUNCTION float f(uint bits) {
  return float_of_bits(bits);
}

FUNCTION Patch patch_at(TILE_PARAMETERS uint i) {
  const uvec4 w0 = PATCH_WORDS(i * 8u), w1 = PATCH_WORDS(i * 8u + 1u), w2 = PATCH_WORDS(i * 8u + 2u),
              w3 = PATCH_WORDS(i * 8u + 3u), w4 = PATCH_WORDS(i * 8u + 4u), w5 = PATCH_WORDS(i * 8u + 5u);
  Patch p;
  p.hi = VEC3(f(w0.x), f(w0.y), f(w0.z));
  p.radius = f(w0.w);
  p.lo = VEC3(f(w1.x), f(w1.y), f(w1.z));
  p.tolerance = f(w1.w);
  p.e0 = VEC3(f(w2.x), f(w2.y), f(w2.z));
  p.area = f(w2.w);
  p.e1 = VEC3(f(w3.x), f(w3.y), f(w3.z));
  p.e2 = VEC3(f(w4.x), f(w4.y), f(w4.z));
  p.normal = VEC3(f(w5.x), f(w5.y), f(w5.z));
  return p;
}

/// From the centroid of x to that of y.
FUNCTION vec3 centroids_between(Patch x, Patch y) {
  return (y.hi - x.hi) + (y.lo - x.lo);
}

/// What a pair is from the heights of its patches over each other's planes, and its S where it is far.
STRUCT(PairResult) {
  uint kind;
  float s;
};

FUNCTION PairResult classified(Patch x, Patch y, float three2, float six2) {
  PairResult result;
  result.kind = NONE;
  result.s = 0.0f;
  const vec3 d = centroids_between(x, y);
  const float distance2 = dot3(d, d), radii = x.radius + y.radius;
  const float over_x = dot3(x.normal, d), over_y = -dot3(y.normal, d);  // of the other's centroid
  const float y0 = dot3(x.normal, y.e0), y1 = dot3(x.normal, y.e1), y2 = dot3(x.normal, y.e2);
  const float x0 = dot3(y.normal, x.e0), x1 = dot3(y.normal, x.e1), x2 = dot3(y.normal, x.e2);
  const float tolerance = x.tolerance + y.tolerance + PLANE_ROUNDING * (square_root(distance2) + radii);
  const float highest = smaller(over_x + larger(y0, larger(y1, y2)), over_y + larger(x0, larger(x1, x2)));
  if (!(highest > tolerance)) return result;
  const float lowest = smaller(over_x + smaller(y0, smaller(y1, y2)), over_y + smaller(x0, smaller(x1, x2)));
  const uint points = points_for(distance2 / (radii * radii), three2, six2);
  result.kind = !(lowest >= -tolerance) ? STRADDLE : points == 3u ? FAR : points == 6u ? MIDDLE : NEAR;
  if (result.kind != FAR) return result;
  // Node k lies half-way from the centroid to corner k, so that a cosine belongs to the node over the plane alone.
  const float cx0 = larger(0.0f, over_x + 0.5f * y0), cx1 = larger(0.0f, over_x + 0.5f * y1),
              cx2 = larger(0.0f, over_x + 0.5f * y2);
  const float cy0 = larger(0.0f, over_y + 0.5f * x0), cy1 = larger(0.0f, over_y + 0.5f * x1),
              cy2 = larger(0.0f, over_y + 0.5f * x2);
  const float unit = 1.0f / distance2;  // r^4 of a small scene is no small number then
  float sum = 0.0f;
  for (uint k = 0u; k < 3u; ++k) {
    const vec3 from = d - 0.5f * (k == 0u ? x.e0 : k == 1u ? x.e1 : x.e2);
    const vec3 d0 = from + 0.5f * y.e0, d1 = from + 0.5f * y.e1, d2 = from + 0.5f * y.e2;
    const float r0 = dot3(d0, d0) * unit, r1 = dot3(d1, d1) * unit, r2 = dot3(d2, d2) * unit;
    sum += (k == 0u ? cy0 : k == 1u ? cy1 : cy2) * (cx0 / (r0 * r0) + cx1 / (r1 * r1) + cx2 / (r2 * r2));
  }
  result.s = sum * unit * x.area * (unit * y.area) * 0.035367765f;  // 1 / (9 pi)
  return result;
}

/// Distance from a plane, where rounding alone is on it.
FUNCTION float snapped(float distance, float rounding) {
  return absolute(distance) <= rounding ? 0.0f : distance;
}

/// The part of y in front of x, relative to the centroid of y; d leads from that of x to it.
FUNCTION Polygon part_in_front(Patch y, Patch x, vec3 d) {
  const float over = dot3(x.normal, d), rounding = 0.5f * PLANE_ROUNDING * (square_root(dot3(d, d)) + y.radius);
  return clip(triangle_of(y.e0, y.e1, y.e2), snapped(over + dot3(x.normal, y.e0), rounding),
              snapped(over + dot3(x.normal, y.e1), rounding), snapped(over + dot3(x.normal, y.e2), rounding));
}

/// The parts of two patches that see each other, each relative to its own centroid.
FUNCTION Polygon visible_part(Patch y, Patch x, vec3 d, uint kind) {
  if (kind == STRADDLE) return part_in_front(y, x, d);
  return triangle_of(y.e0, y.e1, y.e2);
}

/// S of two polygons, each relative to its patch's centroid. `kind` MIDDLE or NEAR says how, any other asks the distance.
FUNCTION float unoccluded(Polygon a, Polygon b, Patch x, Patch y, vec3 d, uint kind, float three2, float six2) {
  const float size = square_root(dot3(d, d)) + x.radius + y.radius, unit = 1.0f / size;
  const Polygon p = moved(a, VEC3(0.0f, 0.0f, 0.0f), unit), q = moved(b, d, unit);
  const uint points = kind == MIDDLE ? 6u : kind == NEAR ? 0u : points_of(p, q, three2, six2);
  return size * size * unoccluded_by(p, q, x.normal, y.normal, points);
}
