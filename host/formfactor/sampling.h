#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "interflect/formfactor/kernel.h"

/// Low-discrepancy points: additive recurrences in 32-bit fixed point, rotated by hashes, so that every sample is a
/// pure function of (seed, patches, piece, number). Beyond word() nothing here needs more than 32-bit integers and
/// single precision: the kernels of the devices do the same, operation by operation.
namespace interflect::sampling {

/// A well-mixed function of its arguments (splitmix64's finaliser).
[[nodiscard]] constexpr std::uint64_t hash(std::uint64_t seed, std::uint64_t value) {
  std::uint64_t z = seed * 0x9e3779b97f4a7c15ULL + value + 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// Steps of the recurrence whose discrepancy is least known in 2 and in 4 dimensions: powers of 1/φ with φ^(d+1) = φ +
/// 1 (Roberts 2018), times 2^32.
inline constexpr std::array<std::uint32_t, 2> step2{3242174889U, 2447445415U};
inline constexpr std::array<std::uint32_t, 4> step4{3679390609U, 3152041523U, 2700274807U, 2313257605U};
/// How far apart the pieces of a cut pair begin.
inline constexpr std::array<std::uint32_t, 2> piece_step{0x9E3779B9U, 0x85EBCA6BU};

/// A point of the unit square in fixed point.
struct Square {
  std::uint32_t u = 0, v = 0;
};

/// The two words by which a patch enters every pair: as the row's (i < j) with the seed, as the column's with seed + 1.
[[nodiscard]] constexpr Square word(std::uint64_t seed, std::uint32_t patch) {
  const std::uint64_t h = hash(seed, patch);
  return {static_cast<std::uint32_t>(h), static_cast<std::uint32_t>(h >> 32)};
}

/// Where the samples on a patch begin in its pair with patch `other`: stratified over consecutive others. `piece` is 0
/// for the whole pair, 1, 2, ... for the pieces of one that was cut.
[[nodiscard]] constexpr Square start(Square word, std::uint32_t other, std::uint32_t piece = 0) {
  return {word.u + other * step2[0] + piece * piece_step[0], word.v + other * step2[1] + piece * piece_step[1]};
}

/// Fixed point to (0, 1), exactly.
[[nodiscard]] inline float unit(std::uint32_t s) {
  return (static_cast<float>(s >> 9) + 0.5F) * 0x1p-23F;
}

/// The point a + u (b − a) + v (c − a) of a triangle.
struct Inside {
  float u, v;
};

/// The square mapped to a triangle without folding distances (Heitz, A low-distortion map between triangle and square).
[[nodiscard]] inline Inside in_triangle(float u, float v) {
  return v > u ? Inside{0.5F * u, v - 0.5F * u} : Inside{u - 0.5F * v, 0.5F * v};
}

struct Float3 {
  float x = 0, y = 0, z = 0;
};
[[nodiscard]] inline Float3 operator+(Float3 a, Float3 b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
[[nodiscard]] inline Float3 operator-(Float3 a, Float3 b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
[[nodiscard]] inline Float3 operator*(float s, Float3 a) {
  return {s * a.x, s * a.y, s * a.z};
}
[[nodiscard]] inline float dot(Float3 a, Float3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
[[nodiscard]] inline Float3 single(Vec3 a) {
  return {static_cast<float>(a.x), static_cast<float>(a.y), static_cast<float>(a.z)};
}

/// What rays start from and end on: a patch, or the part of one in front of another's plane (a fan of two triangles).
struct Facet {
  Float3 corner, normal;
  std::array<Float3, 3> edge;  ///< from the corner to the others; the last one in a fan of two only
  float share_of_first = 1;    ///< of the area

  Facet() = default;
  Facet(const kernel::Polygon& p, Vec3 front) : corner(single(p.corner[0])), normal(single(front)) {
    for (std::size_t k = 1; k < p.size; ++k) edge[k - 1] = single(p.corner[k]) - corner;
    if (p.size != 4) return;
    const double first = kernel::area(kernel::Polygon(p.fan(0))), second = kernel::area(kernel::Polygon(p.fan(1)));
    if (first + second > 0) share_of_first = static_cast<float>(first / (first + second));
  }

  /// Uniform over the facet: the triangles of a fan take their shares of u.
  [[nodiscard]] Float3 at(Square s) const {
    const float u = unit(s.u), v = unit(s.v);
    if (share_of_first >= 1 || u < share_of_first) {
      const Inside in = in_triangle(share_of_first >= 1 ? u : u / share_of_first, v);
      return corner + in.u * edge[0] + in.v * edge[1];
    }
    const Inside in = in_triangle((u - share_of_first) / (1 - share_of_first), v);
    return corner + in.u * edge[1] + in.v * edge[2];
  }
};

/// A shadow ray origin + t direction, 0 < t < 1, and the share of S that it stands for, without a factor that all rays
/// of its pair have in common: cosθ_x cosθ_y / r². Weight 0: on the other's plane, to rounding; not to be traced.
struct ShadowRay {
  Float3 origin, direction;
  float weight = 0;
};

/// Rays shorter than this many lifts weigh no more than those of that length: what they meet is rounding, and near a
/// common edge a single one of them could decide about a pair.
inline constexpr float shortest_in_lifts = 128;

/// Ray number k of the samples that start at `from` on a and at `to` on b; its ends are moved off the facets by `lift`,
/// at most by a quarter of their distance from the other's plane.
[[nodiscard]] inline ShadowRay shadow_ray(const Facet& a, const Facet& b, Square from, Square to, std::uint32_t k,
                                          float lift) {
  const Float3 x = a.at({from.u + k * step4[0], from.v + k * step4[1]});
  const Float3 y = b.at({to.u + k * step4[2], to.v + k * step4[3]});
  const Float3 between = y - x;
  const float above_a = dot(a.normal, between), above_b = -dot(b.normal, between);
  if (!(above_a > 0 && above_b > 0)) return {};
  const Float3 origin = x + std::min(lift, 0.25F * above_a) * a.normal;
  const Float3 end = y + std::min(lift, 0.25F * above_b) * b.normal;
  const float shortest = shortest_in_lifts * lift;
  const float inverse = 1 / std::max(dot(between, between), shortest * shortest);
  return {origin, end - origin, (above_a * inverse) * (above_b * inverse)};
}

}  // namespace interflect::sampling
