#pragma once

#include <cstddef>
#include <cstdint>

#include "interflect/base/half.h"

namespace interflect::simd {

/// out[k] = to_half(row[order[k]] * scale * inverse[k]) for k in [first, n): a row of F in the order of the places. The
/// same halves with every instruction set.
void pack_row(const float* row, const std::uint32_t* order, const float* inverse, float scale, std::size_t first,
              std::size_t n, Half* out);

}  // namespace interflect::simd
