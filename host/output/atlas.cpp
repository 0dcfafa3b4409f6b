#include "interflect/output/atlas.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#define STB_RECT_PACK_IMPLEMENTATION
#define STBRP_STATIC  // other libraries in the process may have a copy of their own
#include <stb/stb_rect_pack.h>

#include "interflect/base/error.h"

namespace interflect {

namespace {

void check(const AtlasOptions& options) {
  const auto demand = [](bool right, const std::string& cause) {
    if (!right) throw Error(ErrorKind::usage, "lightmap: " + cause);
  };
  demand(options.size >= 16 && options.size <= largest_atlas,
         fmt::format("a size of {} is not 16 to {}", options.size, largest_atlas));
  demand(options.padding >= 1 && options.padding <= 64,
         fmt::format("a padding of {} is not 1 to 64 texels", options.padding));
  demand(!options.density || (std::isfinite(*options.density) && *options.density > 0),
         "the density is not a number above 0");
}

/// The places at this density, or nothing when they do not fit.
std::optional<std::vector<Atlas::Place>> place_charts(const Charts& charts, std::uint32_t size, std::uint32_t padding,
                                                      double density) {
  const double room = double(size) - 2 * double(padding);
  double area = 0;
  std::vector<stbrp_rect> rects(charts.list.size());
  for (std::size_t k = 0; k < rects.size(); ++k) {
    const Chart& chart = charts.list[k];
    if (!(chart.width * density <= room && chart.height * density <= room)) return std::nullopt;
    // A length that is a whole number but for rounding gets no texel more.
    const auto texels = [&](double extent) {
      return std::max(1, static_cast<int>(std::ceil(extent * density - 1e-6))) + 2 * static_cast<int>(padding);
    };
    rects[k].id = static_cast<int>(k);
    rects[k].w = texels(chart.width), rects[k].h = texels(chart.height);
    area += double(rects[k].w) * rects[k].h;
  }
  if (area > double(size) * size) return std::nullopt;
  std::vector<stbrp_node> nodes(size);
  stbrp_context context;
  const int side = static_cast<int>(size);
  stbrp_init_target(&context, side, side, nodes.data(), side);
  stbrp_setup_heuristic(&context, STBRP_HEURISTIC_Skyline_BF_sortHeight);
  if (stbrp_pack_rects(&context, rects.data(), static_cast<int>(rects.size())) == 0) return std::nullopt;
  std::vector<Atlas::Place> places;
  const auto whole = [](int n) { return static_cast<std::uint32_t>(n); };
  for (const stbrp_rect& r : rects) places.push_back({whole(r.x), whole(r.y), whole(r.w), whole(r.h)});
  return places;
}

[[noreturn]] void refuse(const Charts& charts, const AtlasOptions& options, double density) {
  const std::string what =
      fmt::format("a lightmap of {0} x {0} texels does not hold {1} charts{2}", options.size, charts.list.size(),
                  density > 0 ? fmt::format(" at {:g} texels per unit", density) : std::string{});
  std::uint64_t size = options.size;
  while ((size *= 2) <= largest_atlas) {
    if (!place_charts(charts, static_cast<std::uint32_t>(size), options.padding, density)) continue;
    throw Error(ErrorKind::limit, fmt::format("{}: --lightmap-size {} does", what, size));
  }
  throw Error(ErrorKind::limit, fmt::format("{}, nor does the largest of {}", what, largest_atlas));
}

}  // namespace

std::array<Vec2, 3> Atlas::texels(const PatchMesh& mesh, std::uint32_t patch) const {
  const auto corners = mesh.triangle(patch);
  const std::uint32_t chart = charts.of_patch[patch];
  return {texels(chart, corners[0]), texels(chart, corners[1]), texels(chart, corners[2])};
}

Atlas make_atlas(const PatchMesh& mesh, const AtlasOptions& options) {
  check(options);
  Atlas atlas{flat_charts(mesh), {}, options.size, options.padding, 0};
  const auto fits = [&](double density) {
    auto places = place_charts(atlas.charts, options.size, options.padding, density);
    if (!places) return false;
    atlas.places = std::move(*places);
    atlas.density = density;
    return true;
  };
  if (options.density) {
    if (!fits(*options.density)) refuse(atlas.charts, options, *options.density);
    return atlas;
  }
  if (!place_charts(atlas.charts, options.size, options.padding, 0)) refuse(atlas.charts, options, 0);
  double area = 0;
  for (const double a : mesh.area) area += a;
  // Between what must fit and what cannot; of a few densities close together the largest that did fit.
  double low = 0, high = options.size / std::sqrt(area);
  constexpr double close_enough = 0.002;
  for (int k = 0; k < 60 && high - low > close_enough * high; ++k) {
    const double middle = 0.5 * (low + high);
    (fits(middle) ? low : high) = middle;
  }
  if (atlas.places.empty()) refuse(atlas.charts, options, high);
  return atlas;
}

}  // namespace interflect
