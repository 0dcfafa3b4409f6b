#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "interflect/output/charts.h"

namespace interflect {

struct AtlasOptions {
  std::uint32_t size = 1024;        ///< texels along each side of the image, 16 to 16,384
  std::uint32_t padding = 2;        ///< texels around each chart, 1 to 64, that hold the chart's own colours
  std::optional<double> density{};  ///< texels per unit of the scene; none: the largest at which all charts fit
};

/// The charts of a mesh placed in one square image, all at the same density. A chart begins at a texel's corner;
/// between two charts are at least 2 * padding texels, between a chart and the image's rim at least `padding`.
struct Atlas {
  /// The texels that are a chart's own: its rectangle with the padding around it.
  struct Place {
    std::uint32_t x = 0, y = 0, width = 0, height = 0;
  };
  Charts charts;
  std::vector<Place> places;  ///< per chart
  std::uint32_t size = 0, padding = 0;
  double density = 0;

  /// Where a point of the chart lies in the image, in texels: x to the right, y down; texel (k, l) is the square from
  /// (k, l) to (k + 1, l + 1).
  [[nodiscard]] Vec2 texels(std::uint32_t chart, Vec3 point) const {
    const Vec2 p = charts.list[chart].place(point);
    return Vec2{double(padding) + places[chart].x, double(padding) + places[chart].y} + p * density;
  }
  [[nodiscard]] std::array<Vec2, 3> texels(const PatchMesh& mesh, std::uint32_t patch) const;
};

inline constexpr std::uint32_t largest_atlas = 16384;  // what GPUs take

/// Throws a limit Error, naming a size that is large enough where there is one, when the charts do not fit; a usage
/// Error for options out of range. Deterministic.
[[nodiscard]] Atlas make_atlas(const PatchMesh& mesh, const AtlasOptions& options);

}  // namespace interflect
