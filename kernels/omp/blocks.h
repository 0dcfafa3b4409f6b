#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

// What the vector kernels share: columns cut into blocks of reduction_block elements, and the fixed tree of a sum.
//   block:  16 lanes, lane l adds elements l, l + 16, ... in order; then the lanes in a tree of four levels
//   column: the blocks' sums one after the other, n / 1024 of them
// The tree depends on n alone, never on the threads, so that a sum has the same bits in every run.

namespace interflect::omp {

inline constexpr std::uint32_t lanes = 16;

/// One block of one column: elements [begin, end) of the vectors, whose column starts at `offset`.
struct Block {
  std::uint32_t column, index;
  std::uint64_t begin, end;  ///< offset of the column included
};

/// The launch's argument block and its vectors; the sums buffer by slots and sets.
class Vectors {
 public:
  explicit Vectors(const Launch& launch) : launch_(launch), a_(launch.arguments<VectorArguments>()) {}

  [[nodiscard]] const VectorArguments& arguments() const { return a_; }

  [[nodiscard]] float* floats(std::size_t buffer) const { return launch_.floats(buffer); }

  /// The float of scalar slot `slot` of a column.
  [[nodiscard]] float& scalar(float* sums, std::uint32_t slot, std::uint32_t column) const {
    return sums[slot * a_.columns + column];
  }
  /// The partial sum of a block in `set`.
  [[nodiscard]] float& partial(float* sums, std::uint32_t set, std::uint32_t column, std::uint32_t block) const {
    return sums[scalar_slots * a_.columns + (set * a_.columns + column) * a_.blocks + block];
  }
  /// The sum of a column: its blocks in order.
  [[nodiscard]] float total(float* sums, std::uint32_t set, std::uint32_t column) const {
    float sum = 0;
    for (std::uint32_t block = 0; block < a_.blocks; ++block) sum += partial(sums, set, column, block);
    return sum;
  }

  /// body(Block) for every block of every column; a single work-group runs without waking the other threads.
  template <class Body>
  void for_each_block(Body body) const {
    const std::uint64_t items = std::uint64_t{a_.columns} * a_.blocks;
    const auto groups = static_cast<std::int64_t>(launch_.groups);
#pragma omp parallel for schedule(static) if (groups > 1)
    for (std::int64_t group = 0; group < groups; ++group) {
      const std::uint64_t first = static_cast<std::uint64_t>(group) * a_.blocks_per_group;
      for (std::uint64_t k = first; k < std::min(items, first + a_.blocks_per_group); ++k) {
        const auto column = static_cast<std::uint32_t>(k / a_.blocks);
        const auto index = static_cast<std::uint32_t>(k % a_.blocks);
        const std::uint64_t offset = std::uint64_t{column} * a_.vector_stride;
        const std::uint64_t begin = std::uint64_t{index} * reduction_block;
        body(Block{column, index, offset + begin, offset + std::min<std::uint64_t>(a_.n, begin + reduction_block)});
      }
    }
  }

 private:
  const Launch& launch_;
  VectorArguments a_;
};

/// Runs element(i, add) over a block, where add(s, term) adds to sum s, and gives the `Count` sums in the fixed tree.
template <std::size_t Count, class Element>
std::array<float, Count> block_sums(const Block& block, Element element) {
  float sums[Count][lanes] = {};
  std::uint64_t i = block.begin;
  for (; i + lanes <= block.end; i += lanes) {
#pragma omp simd
    for (std::uint32_t lane = 0; lane < lanes; ++lane) {
      element(i + lane, [&](std::size_t s, float term) { sums[s][lane] += term; });
    }
  }
  for (std::uint32_t lane = 0; i < block.end; ++i, ++lane) {
    element(i, [&](std::size_t s, float term) { sums[s][lane] += term; });
  }
  std::array<float, Count> result{};
  for (std::size_t s = 0; s < Count; ++s) {
    for (std::uint32_t width = lanes / 2; width > 0; width /= 2) {
      for (std::uint32_t lane = 0; lane < width; ++lane) sums[s][lane] += sums[s][lane + width];
    }
    result[s] = sums[s][0];
  }
  return result;
}

/// The quotient when it is a number of usable size, else 0: a breakdown must not become a NaN.
inline float quotient_or_zero(float numerator, float denominator) {
  const float q = numerator / denominator;
  const float size = q < 0 ? -q : q;
  return size < 1e30F ? q : 0.0F;  // false for a NaN as well
}

}  // namespace interflect::omp
