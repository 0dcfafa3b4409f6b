#pragma once

#include <bit>
#include <cstdint>

// IEEE 754 binary16 as bits: what the 16-bit storage formats hold.

namespace interflect {

using Half = std::uint16_t;

/// The half nearest to a value, ties to even; too large ones become infinity. Values of either sign, no NaN.
/// Without branches, so that a loop of it is vectorized.
[[nodiscard]] inline Half to_half(float value) {
  const auto all = std::bit_cast<std::uint32_t>(value);
  const std::uint32_t sign = all & 0x80000000U;
  const std::uint32_t bits = all ^ sign;
  // Below the smallest normal half, 2^-14, the sum with 0.5 rounds to the place of a subnormal's last bit.
  const std::uint32_t subnormal = std::bit_cast<std::uint32_t>(std::bit_cast<float>(bits) + 0.5F) - 0x3F000000U;
  const std::uint32_t odd = (bits >> 13U) & 1U;
  const std::uint32_t normal = (bits + 0xC8000FFFU + odd) >> 13U;  // exponent moved by 112, half a unit added
  const std::uint32_t small = bits < 0x38800000U ? subnormal : normal;
  const std::uint32_t size = bits >= 0x477FF000U ? 0x7C00U : small;  // from 65,520 on
  return static_cast<Half>(size | sign >> 16U);
}

/// A half's value, exactly.
[[nodiscard]] inline float from_half(Half half) {
  const std::uint32_t sign = (half & 0x8000U) << 16U;
  const std::uint32_t size = half & 0x7FFFU;
  const float normal = std::bit_cast<float>((size << 13U) + 0x38000000U);
  const float subnormal = std::bit_cast<float>((size << 13U) + 0x38800000U) - 0x1p-14F;
  const float infinite = std::bit_cast<float>((size << 13U) + 0x70000000U);
  const float value = size < 0x400U ? subnormal : size >= 0x7C00U ? infinite : normal;
  return std::bit_cast<float>(std::bit_cast<std::uint32_t>(value) | sign);
}

}  // namespace interflect
