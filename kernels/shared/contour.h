// S of two polygons by the contour form: 1/(2 pi) Σ over pairs of edges of cos ∫∫ ln|x - y| ds dt, in single precision.
// host/formfactor/kernel.cpp is the same in double and says where it is from. What keeps the digits here: coordinates
// whose unit is about the size of the pair, so that logarithms are O(1), and no constant under the double integral
// (over closed contours the cosines times the lengths add up to nothing).

/// Convex, counter-clockwise from its front: a patch, or what a plane leaves of it. Corner d is there when size is 4;
/// size 0 is nothing.
STRUCT(Polygon) {
  vec3 a, b, c, d;
  uint size;
};

FUNCTION vec3 corner_of(Polygon p, uint k) {
  return k == 0u ? p.a : k == 1u ? p.b : k == 2u ? p.c : p.d;
}

FUNCTION float dot3(vec3 a, vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

FUNCTION float clamped(float x, float low, float high) {
  return smaller(larger(x, low), high);
}

/// ln x of a normal x > 0, to 2 units in the last place: the languages' own may have 1e-4.
FUNCTION float natural_log(float x) {
  const uint bits = bits_of_float(x);
  const int exponent = TO_INT(bits - 0x3F3504F3u) >> 23;
  const float m = float_of_bits(bits - (TO_UINT(exponent) << 23));  // in [sqrt(1/2), sqrt(2))
  const float s = (m - 1.0f) / (m + 1.0f), z = s * s;
  const float series = 0.33333333f + z * (0.2f + z * (0.14285714f + z * 0.11111111f));
  return TO_FLOAT(exponent) * 0.69314718f + 2.0f * (s + s * z * series);
}

/// The angle of (x, y) from the x axis, y >= 0 and not both 0, to 1e-7.
FUNCTION float angle_of(float y, float x) {
  const float ax = absolute(x), low = smaller(ax, y), high = larger(ax, y);
  const bool turned = low > 0.41421356f * high;  // by 45 degrees
  const float t = (turned ? low - high : low) / (turned ? low + high : high), z = t * t;
  const float series = ((8.05374449e-2f * z - 1.38776856e-1f) * z + 1.99777106e-1f) * z - 3.33329491e-1f;
  const float angle = (turned ? 0.78539816f : 0.0f) + (t + t * z * series);
  const float upper = y > ax ? 1.57079633f - angle : angle;
  return x < 0.0f ? 3.14159265f - upper : upper;
}

FUNCTION float x_log(float x, float square) {
  return square > 1e-30f ? x * natural_log(square) : 0.0f;
}

/// ∫ (ln|p - (b0 + t e)| + 1) dt over t in [0, length], |e| = 1.
FUNCTION float log_integral(vec3 p, vec3 b0, vec3 e, float length) {
  const vec3 w = p - b0;
  const float foot = dot3(w, e);
  const vec3 across = w - foot * e;
  const float h2 = dot3(across, across), h = square_root(h2);
  const float u0 = -foot, u1 = length - foot;
  const float angle = h > 0.0f ? angle_of(h * length, h2 + u0 * u1) : 0.0f;
  return 0.5f * (x_log(u1, u1 * u1 + h2) - x_log(u0, u0 * u0 + h2)) + h * angle;
}

/// Second antiderivative of ln|x|.
FUNCTION float log_twice(float x) {
  return x == 0.0f ? 0.0f : 0.5f * x * x * natural_log(absolute(x)) - 0.75f * x * x;
}

/// Squared distance of two segments p + s d, q + t e (Ericson, Real-Time Collision Detection, 5.1.9).
FUNCTION float segment_distance2(vec3 p, vec3 d, vec3 q, vec3 e) {
  const vec3 r = p - q;
  const float a = dot3(d, d), b = dot3(d, e), c = dot3(d, r), f = dot3(e, r), g = dot3(e, e);
  const float denominator = a * g - b * b;
  float s = denominator > 0.0f ? clamped((b * f - c * g) / denominator, 0.0f, 1.0f) : 0.0f;
  float t = (b * s + f) / g;
  if (t < 0.0f || t > 1.0f) {
    t = clamped(t, 0.0f, 1.0f);
    s = clamped((b * t - c) / a, 0.0f, 1.0f);
  }
  const vec3 gap = r + s * d - t * e;
  return dot3(gap, gap);
}

/// Gauss-Legendre on [0, 1], 4 and 8 points: the lower half of each, the upper one is its mirror.
FUNCTION float gauss_node(uint n, uint points) {
  const uint low = n < points / 2u ? n : points - 1u - n;
  const float x = points == 4u ? (low == 0u ? 0.069431844f : 0.33000948f)
                               : (low == 0u   ? 0.019855072f
                                  : low == 1u ? 0.10166676f
                                  : low == 2u ? 0.23723380f
                                              : 0.40828268f);
  return low == n ? x : 1.0f - x;
}
FUNCTION float gauss_weight(uint n, uint points) {
  const uint low = n < points / 2u ? n : points - 1u - n;
  return points == 4u ? (low == 0u ? 0.17392742f : 0.32607258f)
                      : (low == 0u   ? 0.050614268f
                         : low == 1u ? 0.11119052f
                         : low == 2u ? 0.15685332f
                                     : 0.18134189f);
}

/// A place where the outer edge is split, pulled to an end that it nearly is.
FUNCTION float split_at(float s, float length) {
  return s > 1e-6f * length ? (s < (1.0f - 1e-6f) * length ? s : length) : 0.0f;
}

/// ∫ log_integral() over an edge a of length la from a0 along ua: 4 or 8 points where the other edge is far enough. Else
/// it is split at the feet of that edge's ends and at the closest approach of the two lines, and each part takes
/// 2 x 8 points, graded towards both its ends.
FUNCTION float outer_integral(vec3 a0, vec3 ua, float la, vec3 b0, vec3 ub, float lb) {
  const float gap2 = segment_distance2(a0, la * ua, b0, lb * ub);
  const bool graded = !(gap2 > 0.25f * la * la);
  const uint points = gap2 > 2.25f * la * la ? 4u : 8u;
  float s1 = 0.0f, s2 = 0.0f, s3 = 0.0f;
  if (graded) {
    const vec3 w = b0 - a0;
    const float cosine = dot3(ua, ub), sine2 = 1.0f - cosine * cosine, along = dot3(w, ua);
    const float x = split_at(along, la), y = split_at(along + lb * cosine, la);
    const float z = sine2 > 1e-6f ? split_at((along - cosine * dot3(w, ub)) / sine2, la) : 0.0f;
    s1 = smaller(x, smaller(y, z));
    s3 = larger(x, larger(y, z));
    s2 = larger(smaller(x, y), smaller(larger(x, y), z));
  }
  const uint parts = graded ? 4u : 1u, nodes = graded ? 16u : points;
  float sum = 0.0f;
  for (uint part = 0u; part < parts; ++part) {
    const float from = part == 0u ? 0.0f : part == 1u ? s1 : part == 2u ? s2 : s3;
    const float to = !graded || part == 3u ? la : part == 0u ? s1 : part == 1u ? s2 : s3;
    if (!(to > from)) continue;
    float inner = 0.0f;
    for (uint n = 0u; n < nodes; ++n) {
      const float x = gauss_node(n % 8u, points), weight = gauss_weight(n % 8u, points);
      const float u = graded ? 0.5f * x + (n < 8u ? 0.0f : 0.5f) : x;
      const float at = graded ? u * u * (3.0f - 2.0f * u) : u;
      const float w = graded ? 3.0f * weight * u * (1.0f - u) : weight;
      inner += w * log_integral(a0 + (from + (to - from) * at) * ua, b0, ub, lb);
    }
    sum += (to - from) * inner;
  }
  return sum;
}

/// cos ∫∫ (ln|x - y| + 1) ds dt over the edges a0 a1 and b0 b1.
FUNCTION float edge_pair(vec3 a0, vec3 a1, vec3 b0, vec3 b1) {
  const vec3 a = a1 - a0, b = b1 - b0;
  const float a_length = square_root(dot3(a, a)), b_length = square_root(dot3(b, b));
  const float along = dot3(a, b), lengths = a_length * b_length;
  if (!(absolute(along) > 1e-7f * lengths)) return 0.0f;
  const float cosine = along / lengths;
  const bool swapped = a_length > b_length;  // the shorter one is the outer: smoother
  const vec3 p = swapped ? b0 : a0, q = swapped ? a0 : b0;
  const float lp = swapped ? b_length : a_length, lq = swapped ? a_length : b_length;
  const vec3 up = (swapped ? b : a) * (1.0f / lp), uq = (swapped ? a : b) * (1.0f / lq);
  const vec3 w = q - p, end = w + lq * uq;
  const float f0 = dot3(w, up), f1 = dot3(end, up);
  const vec3 off0 = w - f0 * up, off1 = end - f1 * up;
  if (dot3(off0, off0) < 1e-13f && dot3(off1, off1) < 1e-13f) {  // collinear, to rounding
    const float twice = log_twice(f1) - log_twice(f0) - log_twice(f1 - lp) + log_twice(f0 - lp);
    return cosine * ((f1 > f0 ? twice : -twice) + lengths);
  }
  return cosine * outer_integral(p, up, lp, q, uq, lq);
}

/// S of two polygons that lie in front of each other, in coordinates of size about 1.
FUNCTION float contour(Polygon a, Polygon b) {
  float sum = 0.0f;
  for (uint k = 0u; k < a.size; ++k) {
    const vec3 a0 = corner_of(a, k), a1 = corner_of(a, k + 1u == a.size ? 0u : k + 1u);
    for (uint m = 0u; m < b.size; ++m) {
      sum += edge_pair(a0, a1, corner_of(b, m), corner_of(b, m + 1u == b.size ? 0u : m + 1u));
    }
  }
  return larger(0.0f, sum * 0.15915494f);
}
