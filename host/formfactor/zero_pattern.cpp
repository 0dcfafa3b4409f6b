#include "interflect/formfactor/zero_pattern.h"

#include <array>
#include <bit>

// Highway compiles this file once per instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "interflect/formfactor/zero_pattern.cpp"  // NOLINT: read by foreach_target.h
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace interflect::simd::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

std::uint64_t mark_nonzeros(const float* row, std::size_t n, std::uint64_t* bits) {
  const hn::CappedTag<float, 16> d;
  const std::size_t lanes = hn::Lanes(d);  // a power of 2: 64 is a multiple
  const auto zero = hn::Zero(d);
  std::uint64_t count = 0;
  std::size_t start = 0;
  for (; start + 64 <= n; start += 64) {
    std::uint64_t word = 0;
    for (std::size_t j = 0; j < 64; j += lanes) {
      std::array<std::uint8_t, 8> mask{};  // StoreMaskBits may write 8 bytes
      const auto is_zero = hn::Eq(hn::LoadU(d, row + start + j), zero);
      hn::StoreMaskBits(d, hn::Not(is_zero), mask.data());  // Ne would take NaN for 0 on some targets
      word |= (std::uint64_t{mask[0]} | std::uint64_t{mask[1]} << 8) << j;
    }
    bits[start / 64] |= word;
    count += static_cast<std::uint64_t>(std::popcount(word));
  }
  for (std::size_t j = start; j < n; ++j) {
    if (row[j] == 0) continue;
    bits[j / 64] |= std::uint64_t{1} << (j % 64);
    ++count;
  }
  return count;
}

void differing_bits(const std::uint64_t* rows, std::size_t words, std::uint32_t of, const std::uint32_t* others,
                    std::size_t n, std::uint32_t* count) {
  const hn::CappedTag<std::uint64_t, 8> d;
  const std::size_t lanes = hn::Lanes(d);
  const std::uint64_t* mine = rows + of * words;
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint64_t* its = rows + others[k] * words;
    auto sum = hn::Zero(d);
    for (std::size_t w = 0; w < words; w += lanes) {
      sum = hn::Add(sum, hn::PopulationCount(hn::Xor(hn::LoadU(d, mine + w), hn::LoadU(d, its + w))));
    }
    count[k] = static_cast<std::uint32_t>(hn::GetLane(hn::SumOfLanes(d, sum)));
  }
}

}  // namespace interflect::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace interflect::simd {

HWY_EXPORT(mark_nonzeros);
HWY_EXPORT(differing_bits);

std::uint64_t mark_nonzeros(std::span<const float> row, std::span<std::uint64_t> bits) {
  return HWY_DYNAMIC_DISPATCH(mark_nonzeros)(row.data(), row.size(), bits.data());
}

void differing_bits(std::span<const std::uint64_t> rows, std::size_t words, std::uint32_t of,
                    std::span<const std::uint32_t> others, std::span<std::uint32_t> count) {
  HWY_DYNAMIC_DISPATCH(differing_bits)(rows.data(), words, of, others.data(), others.size(), count.data());
}

}  // namespace interflect::simd
#endif
