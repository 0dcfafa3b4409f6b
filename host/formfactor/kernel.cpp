#include "interflect/formfactor/kernel.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace interflect::kernel {

namespace {

struct Node {
  double x, weight;
};

// Gauss-Legendre on [0, 1].
constexpr std::array<Node, 4> gauss4{{{0.06943184420297371, 0.17392742256872693},
                                      {0.33000947820757187, 0.32607257743127307},
                                      {0.6699905217924281, 0.32607257743127307},
                                      {0.9305681557970263, 0.17392742256872693}}};
constexpr std::array<Node, 8> gauss8{{{0.019855071751231884, 0.05061426814518813},
                                      {0.10166676129318664, 0.11119051722668724},
                                      {0.2372337950418355, 0.15685332293894363},
                                      {0.4082826787521751, 0.181341891689181},
                                      {0.591717321247825, 0.181341891689181},
                                      {0.7627662049581645, 0.15685332293894363},
                                      {0.8983332387068134, 0.11119051722668724},
                                      {0.9801449282487681, 0.05061426814518813}}};

double squared(double x) {
  return x * x;
}

double x_log(double x, double square) {
  return square > 0 ? x * std::log(square) : 0;
}

/// ∫ ln|p − (b0 + t e)| dt over t in [0, length], |e| = 1.
double log_integral(Vec3 p, Vec3 b0, Vec3 e, double length) {
  const Vec3 w = p - b0;
  const double foot = dot(w, e);
  const Vec3 across = w - foot * e;
  const double h2 = dot(across, across);
  const double h = std::sqrt(h2);
  const double u0 = -foot, u1 = length - foot;
  const double angle = h > 0 ? std::atan2(h * length, h2 + u0 * u1) : 0;
  return 0.5 * (x_log(u1, u1 * u1 + h2) - x_log(u0, u0 * u0 + h2)) - length + h * angle;
}

/// Second antiderivative of ln|x|.
double log_twice(double x) {
  return x == 0 ? 0 : 0.5 * x * x * std::log(std::abs(x)) - 0.75 * x * x;
}

/// Squared distance of two segments p + s d, q + t e, s and t in [0, 1] (Ericson, Real-Time Collision
/// Detection, 5.1.9).
double segment_distance2(Vec3 p, Vec3 d, Vec3 q, Vec3 e) {
  const Vec3 r = p - q;
  const double a = dot(d, d), b = dot(d, e), c = dot(d, r), f = dot(e, r), g = dot(e, e);
  const double denominator = a * g - b * b;
  double s = denominator > 0 ? std::clamp((b * f - c * g) / denominator, 0.0, 1.0) : 0;
  double t = (b * s + f) / g;
  if (t < 0 || t > 1) {
    t = std::clamp(t, 0.0, 1.0);
    s = std::clamp((b * t - c) / a, 0.0, 1.0);
  }
  const Vec3 gap = r + s * d - t * e;
  return dot(gap, gap);
}

struct Edge {
  Vec3 start, unit;
  double length;
  [[nodiscard]] Vec3 at(double s) const { return start + s * unit; }
};

/// ∫ log_integral over [from, to] of the outer edge.
template <std::size_t N>
double plain(const std::array<Node, N>& rule, const Edge& a, const Edge& b) {
  double sum = 0;
  for (const Node& node : rule) sum += node.weight * log_integral(a.at(node.x * a.length), b.start, b.unit, b.length);
  return sum * a.length;
}

/// The same on [from, to] with s = from + (to − from) u²(3 − 2u): points gather at both ends, where the inner integral
/// behaves like s ln s; 16 points in two halves.
double graded(const Edge& a, const Edge& b, double from, double to) {
  double sum = 0;
  for (const double half : {0.0, 0.5}) {
    for (const Node& node : gauss8) {
      const double u = half + 0.5 * node.x;
      const double s = from + (to - from) * u * u * (3 - 2 * u);
      sum += 0.5 * node.weight * 6 * u * (1 - u) * log_integral(a.at(s), b.start, b.unit, b.length);
    }
  }
  return sum * (to - from);
}

/// Splits the outer edge at the feet of the inner edge's ends and at the closest approach of the two lines.
double split(const Edge& a, const Edge& b) {
  std::array<double, 5> at{0, a.length, 0, 0, 0};
  std::size_t count = 2;
  const auto add = [&](double s) {
    if (!(s > 1e-9 * a.length && s < (1 - 1e-9) * a.length)) return;
    std::size_t k = count++;
    for (; at[k - 1] > s; --k) at[k] = at[k - 1];  // at[0] = 0 ends this
    at[k] = s;
  };
  add(dot(b.start - a.start, a.unit));
  add(dot(b.at(b.length) - a.start, a.unit));
  const double cosine = dot(a.unit, b.unit);
  const double sine2 = 1 - cosine * cosine;
  const Vec3 w = b.start - a.start;
  if (sine2 > 1e-6) add((dot(w, a.unit) - cosine * dot(w, b.unit)) / sine2);
  double sum = 0;
  for (std::size_t k = 0; k + 1 < count; ++k) sum += graded(a, b, at[k], at[k + 1]);
  return sum;
}

double outer_integral(const Edge& a, const Edge& b) {
  const double gap2 = segment_distance2(a.start, a.length * a.unit, b.start, b.length * b.unit);
  const double l2 = a.length * a.length;
  if (gap2 > 2.25 * l2) return plain(gauss4, a, b);
  if (gap2 > 0.25 * l2) return plain(gauss8, a, b);
  return split(a, b);
}

constexpr std::array<std::array<double, 3>, 3> three_points{
    {{2.0 / 3, 1.0 / 6, 1.0 / 6}, {1.0 / 6, 2.0 / 3, 1.0 / 6}, {1.0 / 6, 1.0 / 6, 2.0 / 3}}};

// Dunavant 1985, degree 4.
constexpr double d4a = 0.445948490915965, d4wa = 0.223381589678011;
constexpr double d4b = 0.091576213509771, d4wb = 0.109951743655322;
constexpr std::array<std::array<double, 3>, 6> six_points{{{d4a, d4a, 1 - 2 * d4a},
                                                           {d4a, 1 - 2 * d4a, d4a},
                                                           {1 - 2 * d4a, d4a, d4a},
                                                           {d4b, d4b, 1 - 2 * d4b},
                                                           {d4b, 1 - 2 * d4b, d4b},
                                                           {1 - 2 * d4b, d4b, d4b}}};
constexpr std::array<double, 6> six_weights{d4wa, d4wa, d4wa, d4wb, d4wb, d4wb};

}  // namespace

Samples samples(const Polygon& a, int points) {
  Samples out;
  out.normal = {};
  for (std::size_t k = 0; k + 2 < a.size; ++k) {
    const auto t = a.fan(k);
    const Vec3 twice = cross(t[1] - t[0], t[2] - t[0]);
    const double part = 0.5 * length(twice);
    out.normal += twice;
    const auto add = [&](const std::array<double, 3>& c, double w) {
      out.sample[out.size++] = {c[0] * t[0] + c[1] * t[1] + c[2] * t[2], w * part};
    };
    if (points == 3) {
      for (const auto& c : three_points) add(c, 1.0 / 3);
    } else {
      for (std::size_t q = 0; q < 6; ++q) add(six_points[q], six_weights[q]);
    }
  }
  out.normal = normalized(out.normal);
  return out;
}

double area(const Polygon& a) {
  Vec3 twice{};
  for (std::size_t k = 0; k + 2 < a.size; ++k) {
    const auto t = a.fan(k);
    twice += cross(t[1] - t[0], t[2] - t[0]);
  }
  return 0.5 * length(twice);
}

Vec3 centroid(const Polygon& a) {
  Vec3 sum{};
  double weight = 0;
  for (std::size_t k = 0; k + 2 < a.size; ++k) {
    const auto t = a.fan(k);
    const double part = length(cross(t[1] - t[0], t[2] - t[0]));
    sum += (part / 3) * (t[0] + t[1] + t[2]);
    weight += part;
  }
  return weight > 0 ? sum / weight : a.corner[0];
}

Polygon clip(const std::array<Vec3, 3>& triangle, const Plane& plane, double on_plane) {
  Polygon out;
  std::array<double, 3> distance{};
  for (std::size_t k = 0; k < 3; ++k) {
    distance[k] = plane.distance(triangle[k]);
    if (std::abs(distance[k]) <= on_plane) distance[k] = 0;
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 p = triangle[k], q = triangle[(k + 1) % 3];
    const double dp = distance[k], dq = distance[(k + 1) % 3];
    if (dp >= 0) out.corner[out.size++] = p;
    if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0)) out.corner[out.size++] = p + (dp / (dp - dq)) * (q - p);
  }
  if (out.size < 3) out.size = 0;
  return out;
}

double edge_pair(Vec3 a0, Vec3 a1, Vec3 b0, Vec3 b1) {
  Edge a{a0, a1 - a0, 0}, b{b0, b1 - b0, 0};
  const double along = dot(a.unit, b.unit);
  a.length = length(a.unit);
  b.length = length(b.unit);
  const double lengths = a.length * b.length;
  if (!(std::abs(along) > 1e-14 * lengths)) return 0;
  a.unit = a.unit / a.length;
  b.unit = b.unit / b.length;
  if (a.length > b.length) std::swap(a, b);  // the shorter one is the outer: smoother
  const double cosine = along / lengths;
  const Vec3 w = b.start - a.start;
  const double tolerance = 1e-18 * squared(b.length);
  const double f0 = dot(w, a.unit), f1 = f0 + b.length * dot(b.unit, a.unit);
  const Vec3 off0 = w - f0 * a.unit, off1 = b.at(b.length) - a.start - f1 * a.unit;
  if (dot(off0, off0) < tolerance && dot(off1, off1) < tolerance) {
    const double collinear = log_twice(f1) - log_twice(f0) - log_twice(f1 - a.length) + log_twice(f0 - a.length);
    return collinear * (f1 > f0 ? 1 : -1) * cosine;
  }
  return cosine * outer_integral(a, b);
}

double contour(const Polygon& a, const Polygon& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size; ++k) {
    for (std::size_t m = 0; m < b.size; ++m) {
      sum += edge_pair(a.corner[k], a.corner[(k + 1) % a.size], b.corner[m], b.corner[(m + 1) % b.size]);
    }
  }
  return std::max(0.0, sum / (2 * std::numbers::pi));
}

double quadrature(const Polygon& a, const Polygon& b, int points) {
  return quadrature(samples(a, points), samples(b, points));
}

double quadrature(const Samples& x, const Samples& y) {
  double sum = 0;
  for (std::size_t k = 0; k < x.size; ++k) {
    double inner = 0;
    for (std::size_t m = 0; m < y.size; ++m) {
      const Vec3 d = y.sample[m].position - x.sample[k].position;
      const double r2 = dot(d, d);
      const double cosines = std::max(0.0, dot(x.normal, d)) * std::max(0.0, -dot(y.normal, d));
      inner += y.sample[m].weight * cosines / (r2 * r2);
    }
    sum += x.sample[k].weight * inner;
  }
  return sum / std::numbers::pi;
}

double unoccluded(const Polygon& a, const Polygon& b, const Ratios& ratios) {
  const Vec3 ca = centroid(a), cb = centroid(b);
  double ra = 0, rb = 0;
  for (const Vec3 p : a.corners()) ra = std::max(ra, dot(p - ca, p - ca));
  for (const Vec3 p : b.corners()) rb = std::max(rb, dot(p - cb, p - cb));
  const double ratio2 = dot(ca - cb, ca - cb) / squared(std::sqrt(ra) + std::sqrt(rb));
  if (ratio2 > squared(static_cast<double>(ratios.three_points))) return quadrature(a, b, 3);
  if (ratio2 > squared(static_cast<double>(ratios.six_points))) return quadrature(a, b, 6);
  return contour(a, b);
}

}  // namespace interflect::kernel
