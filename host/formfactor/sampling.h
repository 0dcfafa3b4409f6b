#pragma once

#include <array>
#include <cstdint>

#include "interflect/formfactor/kernel.h"

/// Low-discrepancy points: additive recurrences in 32-bit fixed point, rotated by hashes, so that every sample is a
/// pure function of (seed, patches, number).
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

/// A point of the unit square in fixed point.
struct Square {
  std::uint32_t u = 0, v = 0;
};

/// The point of [0, 1)² that (i, j) gives in a row of j, rotated by the hash of i: stratified over consecutive j.
[[nodiscard]] constexpr Square rotated(std::uint64_t hash_of_i, std::uint32_t j) {
  return {static_cast<std::uint32_t>(hash_of_i) + j * step2[0],
          static_cast<std::uint32_t>(hash_of_i >> 32) + j * step2[1]};
}

/// The square mapped to a triangle without folding distances (Heitz, A low-distortion map between triangle and square).
[[nodiscard]] inline Vec3 on_triangle(const std::array<Vec3, 3>& t, Square s) {
  constexpr double unit = 1.0 / 4294967296.0;
  double u = (s.u + 0.5) * unit, v = (s.v + 0.5) * unit;
  if (v > u) {
    u *= 0.5;
    v -= u;
  } else {
    v *= 0.5;
    u -= v;
  }
  return t[0] + u * (t[1] - t[0]) + v * (t[2] - t[0]);
}

/// Uniform over a polygon: its fan triangles take their shares of u.
[[nodiscard]] inline Vec3 on_polygon(const kernel::Polygon& p, Square s, double share_of_first) {
  if (p.size == 3) return on_triangle(p.fan(0), s);
  const double u = (s.u + 0.5) / 4294967296.0;
  const bool first = u < share_of_first;
  const double within = first ? u / share_of_first : (u - share_of_first) / (1 - share_of_first);
  const Square inner{static_cast<std::uint32_t>(within * 4294967295.0), s.v};
  return on_triangle(p.fan(first ? 0 : 1), inner);
}

}  // namespace interflect::sampling
