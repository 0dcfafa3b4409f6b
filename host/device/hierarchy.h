#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect {

/// A bounding volume hierarchy over triangles as the kernels traverse it (kernels/shared/occluded.h): built once on the
/// host, the same for all devices, a function of its input alone. Every inner node has up to four children, boxes or
/// leaves of up to four triangles; node 0 is the root, also where there are no triangles.
///
/// A node is 16 words: the corner of its box (3 floats); three biased exponents of powers of two, a byte for each axis,
/// the lowest x; for the axes x, y, z the low sides of the four children's boxes, a byte for each child, then a word
/// that means nothing, the same for the high sides; the four children. A side is at corner + byte * 2^(exponent − 127).
/// A child is the number of a node or, with leaf_bit, of a leaf. An absent one has low 255 and high 0, and repeats
/// another child, so that a kernel need not look for it. A leaf is 36 floats: x, y, z of the first vertex of its four
/// triangles (four floats each), then of the second and the third; absent ones have no extent.
class Hierarchy {
 public:
  static constexpr std::uint32_t node_words = 16, leaf_floats = 36, leaf_bit = 0x80000000U;
  /// Levels of inner nodes at most, for any input: a kernel's stack of 3 * most_levels + 1 children always does. Where
  /// the splits by area would go deeper, the triangles are halved by number.
  static constexpr std::uint32_t most_levels = 20;

  /// Over triangles given as indices into vertices, which are rounded to fp32 and must be finite. Throws a limit Error
  /// for more triangles than largest_hierarchy leaves hold.
  Hierarchy(std::span<const Vec3> vertices, std::span<const std::array<std::uint32_t, 3>> triangles);

  [[nodiscard]] std::span<const std::uint32_t> nodes() const { return nodes_; }
  [[nodiscard]] std::span<const float> leaves() const { return leaves_; }
  [[nodiscard]] std::uint32_t node_count() const { return static_cast<std::uint32_t>(nodes_.size() / node_words); }
  [[nodiscard]] std::uint32_t leaf_count() const { return static_cast<std::uint32_t>(leaves_.size() / leaf_floats); }
  /// Inner nodes on the longest way down.
  [[nodiscard]] std::uint32_t levels() const { return levels_; }

 private:
  class Builder;
  std::vector<std::uint32_t> nodes_;
  std::vector<float> leaves_;
  std::uint32_t levels_ = 0;
};

}  // namespace interflect
