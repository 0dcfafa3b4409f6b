#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "interflect/formfactor/patch_table.h"

/// The loops over all pairs, in SIMD through Highway with run-time dispatch.
namespace interflect::simd {

/// How the pair (i, j) is to be treated.
enum class PairKind : std::uint8_t {
  none,      ///< one lies behind or in the plane of the other: S = 0
  far,       ///< S is there already, by 3 x 3 points
  middle,    ///< 6 x 6 points
  near,      ///< the contour form
  straddle,  ///< one is cut by the plane of the other
};

/// Patch i against the block of patches that starts at `first`: what kind of pair each is, and S where it is far.
void classify(const PatchTable& patches, const kernel::Ratios& ratios, std::size_t i, std::size_t first,
              std::span<PairKind, PatchTable::block> kind, std::span<double, PatchTable::block> s);

/// Σ_j row[j] x[j]: products and sums of 1,024 elements in single precision, the rest in double.
[[nodiscard]] double dot(std::span<const float> row, std::span<const float> x);

/// row[j] ← row[j] · (factor · x[j]). Returns the least and the largest x[j] where row[j] is not 0 (or inf, 0).
struct Extremes {
  float low, high;
};
Extremes scale(std::span<float> row, float factor, std::span<const float> x);

}  // namespace interflect::simd
