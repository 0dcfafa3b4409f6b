// Polygons of a pair: clipping, quadrature, and S by whichever way fits the distance. As host/formfactor/kernel.h, in
// single precision; every coordinate is relative to a point near the pair.

FUNCTION vec3 cross3(vec3 a, vec3 b) {
  return VEC3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

FUNCTION Polygon triangle_of(vec3 a, vec3 b, vec3 c) {
  Polygon p;
  p.a = a;
  p.b = b;
  p.c = c;
  p.d = c;
  p.size = 3u;
  return p;
}

FUNCTION Polygon moved(Polygon p, vec3 by, float scale) {
  Polygon q;
  q.a = scale * (p.a + by);
  q.b = scale * (p.b + by);
  q.c = scale * (p.c + by);
  q.d = scale * (p.d + by);
  q.size = p.size;
  return q;
}

/// Triangle k of the fan around corner a.
FUNCTION Polygon fan_of(Polygon p, uint k) {
  return k == 0u ? triangle_of(p.a, p.b, p.c) : triangle_of(p.a, p.c, p.d);
}

FUNCTION float area_of(Polygon p) {
  vec3 twice = cross3(p.b - p.a, p.c - p.a);
  if (p.size == 4u) twice = twice + cross3(p.c - p.a, p.d - p.a);
  return p.size == 0u ? 0.0f : 0.5f * square_root(dot3(twice, twice));
}

/// One of the four triangles that the midpoints of its edges cut a triangle into.
FUNCTION Polygon quarter_of(Polygon t, uint k) {
  const vec3 ab = 0.5f * (t.a + t.b), bc = 0.5f * (t.b + t.c), ca = 0.5f * (t.c + t.a);
  if (k == 0u) return triangle_of(t.a, ab, ca);
  if (k == 1u) return triangle_of(ab, t.b, bc);
  if (k == 2u) return triangle_of(ca, bc, t.c);
  return triangle_of(ab, bc, ca);
}

FUNCTION Polygon with_corner(Polygon p, vec3 x) {
  Polygon q = p;
  if (p.size == 0u) q.a = x;
  if (p.size == 1u) q.b = x;
  if (p.size == 2u) q.c = x;
  if (p.size == 3u) q.d = x;
  q.size = p.size + 1u;
  return q;
}

/// The part of the triangle in front of a plane from which its corners are at the distances da, db, dc.
FUNCTION Polygon clip(Polygon t, float da, float db, float dc) {
  Polygon kept = t;
  kept.size = 0u;
  for (uint k = 0u; k < 3u; ++k) {
    const vec3 p = k == 0u ? t.a : k == 1u ? t.b : t.c, q = k == 0u ? t.b : k == 1u ? t.c : t.a;
    const float dp = k == 0u ? da : k == 1u ? db : dc, dq = k == 0u ? db : k == 1u ? dc : da;
    if (dp >= 0.0f) kept = with_corner(kept, p);
    if ((dp > 0.0f && dq < 0.0f) || (dp < 0.0f && dq > 0.0f)) kept = with_corner(kept, p + (dp / (dp - dq)) * (q - p));
  }
  if (kept.size < 3u) kept.size = 0u;
  return kept;
}

/// Point q of 3 (degree 2) or 6 (Dunavant's of degree 4) on a triangle, and its weight.
FUNCTION vec3 quadrature_point(Polygon t, uint q, uint points) {
  const float x = points == 3u ? 0.16666667f : q < 3u ? 0.44594849f : 0.091576214f;
  const vec3 special = q % 3u == 0u ? t.c : q % 3u == 1u ? t.b : t.a;
  return x * (t.a + t.b + t.c) + (1.0f - 3.0f * x) * special;
}
FUNCTION float quadrature_weight(uint q, uint points) {
  return points == 3u ? 0.33333333f : q < 3u ? 0.22338159f : 0.10995174f;
}

/// S by quadrature over both areas, `points` per triangle of either fan; the polygons' normals have unit length.
FUNCTION float quadrature(Polygon a, Polygon b, vec3 na, vec3 nb, uint points) {
  float sum = 0.0f;
  for (uint f = 0u; f + 2u < a.size; ++f) {
    const Polygon ta = fan_of(a, f);
    const float area_a = area_of(ta);
    for (uint g = 0u; g + 2u < b.size; ++g) {
      const Polygon tb = fan_of(b, g);
      float part = 0.0f;
      for (uint k = 0u; k < points; ++k) {
        const vec3 x = quadrature_point(ta, k, points);
        float inner = 0.0f;
        for (uint m = 0u; m < points; ++m) {
          const vec3 d = quadrature_point(tb, m, points) - x;
          const float r2 = dot3(d, d), cosines = larger(0.0f, dot3(na, d)) * larger(0.0f, -dot3(nb, d));
          inner += quadrature_weight(m, points) * cosines / (r2 * r2);
        }
        part += quadrature_weight(k, points) * inner;
      }
      sum += area_a * area_of(tb) * part;
    }
  }
  return sum * 0.31830989f;
}

FUNCTION vec3 centroid_of(Polygon p) {
  const vec3 first = p.a + p.b + p.c;
  if (p.size == 3u) return 0.33333333f * first;
  const float wa = area_of(fan_of(p, 0u)), wb = area_of(fan_of(p, 1u));
  if (!(wa + wb > 0.0f)) return p.a;
  return (wa * first + wb * (p.a + p.c + p.d)) * (0.33333333f / (wa + wb));
}

FUNCTION float radius2_of(Polygon p, vec3 from) {
  float most = 0.0f;
  for (uint k = 0u; k < p.size; ++k) {
    const vec3 d = corner_of(p, k) - from;
    most = larger(most, dot3(d, d));
  }
  return most;
}

/// How S of a pair is found, from the squared distance of the centroids over that of the radii's sum: 3 or 6 points, or
/// 0, the contour form. three2 and six2: from which squared ratio the points do.
FUNCTION uint points_for(float ratio2, float three2, float six2) {
  return ratio2 > three2 ? 3u : ratio2 > six2 ? 6u : 0u;
}

/// S of two polygons in coordinates of size about 1; `points` as points_for() says.
FUNCTION float unoccluded_by(Polygon a, Polygon b, vec3 na, vec3 nb, uint points) {
  if (points == 0u) return contour(a, b);
  return quadrature(a, b, na, nb, points);
}
FUNCTION uint points_of(Polygon a, Polygon b, float three2, float six2) {
  const vec3 ca = centroid_of(a), cb = centroid_of(b), d = cb - ca;
  const float radii = square_root(radius2_of(a, ca)) + square_root(radius2_of(b, cb));
  return points_for(dot3(d, d) / (radii * radii), three2, six2);
}
