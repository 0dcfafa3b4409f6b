#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "interflect/scene/scene.h"

namespace interflect {

/// Throws a usage Error when the scene does not hold what Scene promises: an index out of range, a coordinate that is
/// not finite. Readers never make such a scene; a program that fills one by hand may. Throws an input Error for a
/// triangle whose area is too large for a double.
void require_sound(const Scene& scene);

/// True when area < 1e-12 · (longest edge)²: no area up to rounding, hence no normal. Also for repeated corners.
[[nodiscard]] bool degenerate(Vec3 a, Vec3 b, Vec3 c);
[[nodiscard]] bool degenerate(const Scene& scene, const Triangle& t);

/// The altitude over the longest edge, the smallest distance between a corner and the opposite side.
[[nodiscard]] double smallest_altitude(Vec3 a, Vec3 b, Vec3 c);

/// Length of the bounding box's diagonal over the corners of all triangles.
[[nodiscard]] double diagonal(const Scene& scene);

/// True when a triangle of the scene gets a patch on each side.
[[nodiscard]] bool has_two_sides(const Scene& scene, const Triangle& t, bool two_sided);

/// Gives points that lie within a tolerance of each other one index. The first point that comes keeps its place.
class VertexWelder {
 public:
  /// `tolerance`: the largest tolerance that index_of() will be asked for.
  explicit VertexWelder(double tolerance);

  /// The index of the nearest point within min(tolerance, the constructor's), or of a new one. At most 64 points of a
  /// cell are compared, so that a file with a far outlier, whose cells are large, costs time linear in its size;
  /// beyond that only equal points merge.
  [[nodiscard]] std::uint32_t index_of(Vec3 p, double tolerance);
  [[nodiscard]] const std::vector<Vec3>& points() const { return points_; }
  [[nodiscard]] std::vector<Vec3> take() { return std::move(points_); }

 private:
  using Key = std::array<std::int64_t, 3>;
  struct Hash {
    std::size_t operator()(const Key& key) const noexcept;
  };
  [[nodiscard]] std::int64_t cell(double x) const;
  [[nodiscard]] std::uint32_t add(Vec3 p, const Key& exact);

  double tolerance_;
  double cell_size_;
  std::vector<Vec3> points_;
  std::vector<std::uint32_t> next_;  ///< the point that came before in the same cell
  std::unordered_map<Key, std::uint32_t, Hash> exact_;
  std::unordered_map<Key, std::uint32_t, Hash> cells_;  ///< the last point that came into a cell
};

/// The tolerance for welding a scene whose patches have the given altitudes: 1e-6 of the diagonal, but no more than
/// 1e-3 of the median altitude.
[[nodiscard]] double weld_tolerance(double diagonal, std::vector<double> altitudes);

/// The share of its altitude by which a corner of a patch may move when welded: too little to collapse it.
inline constexpr double weld_share_of_altitude = 1e-3;

}  // namespace interflect
