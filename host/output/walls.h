#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

class Continues;

/// A patch on which other surfaces stand away from its edges: a floor that goes on under a wall or a cabinet. Its
/// radiosity is a mean of what lies on either side, so neither side may be shaded with it, nor with the corners that
/// lie on the other one.
struct Cut {
  using Segment = std::array<Vec2, 2>;
  std::vector<Segment> walls;  ///< feet, in (u, v): the point is (1 − u − v) a + u b + v c
  /// Per corner: which corners (bits) lie in the same part of the patch as this one; 0 where a wall stands on it.
  std::array<std::uint8_t, 3> part{};
  std::array<double, 3> share{};  ///< per corner: of the patch's area, its part

  /// The corners (bits) of the part in which (u, v) lies; all of them where that part has none.
  [[nodiscard]] std::uint8_t corners_at(double u, double v) const;
  /// The shares of the corners at the point that they make together: only those on its own side of the walls, in the
  /// same proportions; they add up to 1.
  [[nodiscard]] std::array<double, 3> shares(std::array<double, 3> at) const;
};

/// Where surfaces stand on the fronts of patches, whether they share vertices with them or not. A surface stands on a
/// patch when it touches or crosses its plane there and rises from it by more than about 6 degrees. What continues the
/// patch's own surface does not count.
class Walls {
 public:
  /// No walls at all.
  Walls() = default;
  Walls(const PatchMesh& mesh, const Continues& continues);

  /// Whether a wall stands on edge k (from corner k to the next) of patch i at t, 0 to 1 along it.
  [[nodiscard]] bool on_edge(std::uint32_t i, std::size_t k, double t) const;
  [[nodiscard]] const Cut* cut(std::uint32_t i) const {
    return index_.empty() || index_[i] == none ? nullptr : &cuts_[index_[i]];
  }
  [[nodiscard]] std::size_t size() const { return cuts_.size(); }

 private:
  static constexpr std::uint32_t none = 0xFFFFFFFF;
  struct OnEdge {
    std::uint32_t patch = 0;
    std::uint32_t edge = 0;
    double from = 0, to = 0;
  };
  std::vector<OnEdge> edges_;  ///< sorted by patch
  std::vector<Cut> cuts_;
  std::vector<std::uint32_t> index_;  ///< per patch, into cuts_; empty where there are none
};

}  // namespace interflect
