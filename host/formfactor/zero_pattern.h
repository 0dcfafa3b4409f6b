#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

/// Which elements of a row are not zero, as bits; in SIMD through Highway with run-time dispatch.
namespace interflect::simd {

/// Sets bit j % 64 of bits[j / 64] where row[j] is not 0 (NaN is not 0) and leaves the other bits as they are. `bits`
/// has at least ceil(row.size() / 64) words. Returns how many elements of the row are not 0.
std::uint64_t mark_nonzeros(std::span<const float> row, std::span<std::uint64_t> bits);

/// How many bits of the row `of` differ from those of each row in `others` (Hamming distance), into `count`, which is
/// as long as `others`. `rows` holds bit rows of `words` words each; words is a multiple of 8.
void differing_bits(std::span<const std::uint64_t> rows, std::size_t words, std::uint32_t of,
                    std::span<const std::uint32_t> others, std::span<std::uint32_t> count);

}  // namespace interflect::simd
