#include "lightmap_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/output/lightmap.h"
#include "outputs.h"
#include "validators.h"

namespace interflect::cli {

void add_lightmap_options(CLI::App& command, LightmapOptions& options) {
  auto* wanted = command.add_flag("--lightmap", options.wanted,
                                  "light the .glb by an embedded image (lightmap) instead of colours at its vertices");
  command
      .add_option(
          "--lightmap-image", options.images,
          "keep the lightmap in this file, too: .exr (linear radiosity) or .png (16 bits); may be given several "
          "times")
      ->check(file_name())
      ->type_size(1)
      ->allow_extra_args(false)
      ->needs(wanted);
  command.add_option("--lightmap-size", options.atlas.size, "texels along each side of the lightmap, 16 to 16384")
      ->check(number(15U, largest_atlas))
      ->needs(wanted)
      ->capture_default_str();
  command
      .add_option("--lightmap-density", options.atlas.density,
                  "texels per unit of length; without it, as many as there is room for")
      ->check(number(0.0))
      ->needs(wanted);
  command.add_option("--lightmap-padding", options.atlas.padding, "texels around each chart that repeat its rim")
      ->check(number(0U, 64U))
      ->needs(wanted)
      ->capture_default_str();
}

void check_lightmap(const LightmapOptions& options, const std::vector<std::string>& outputs) {
  if (!options.wanted) return;
  const auto is_glb = [](const std::string& file) { return extension_of(file) == ".glb"; };
  if (std::none_of(outputs.begin(), outputs.end(), is_glb)) {
    throw Error(ErrorKind::usage, "--lightmap: there is no -o FILE.glb, which says what lies where in the lightmap");
  }
  for (const std::string& image : options.images) {
    if (extension_of(image) == ".exr" || extension_of(image) == ".png") continue;
    throw Error(ErrorKind::usage, fmt::format("--lightmap-image {}: a lightmap image is .exr or .png", image));
  }
  const std::uint64_t needed = lightmap_bytes(options.atlas.size), available = available_memory();
  if (needed <= available) return;
  constexpr double mebibyte = 1 << 20;
  throw Error(ErrorKind::limit,
              fmt::format("--lightmap-size {}: the lightmap needs {:.0f} MiB, and {:.0f} MiB may be used: use a "
                          "smaller one",
                          options.atlas.size, static_cast<double>(needed) / mebibyte,
                          static_cast<double>(available) / mebibyte));
}

std::optional<Atlas> lightmap_atlas(const LightmapOptions& options, const PatchMesh& mesh, ProgressSink& progress) {
  if (!options.wanted) return std::nullopt;
  Atlas atlas = make_atlas(mesh, options.atlas);
  std::vector<double> areas = mesh.area;
  const auto middle = areas.begin() + static_cast<std::ptrdiff_t>(areas.size() / 2);
  std::nth_element(areas.begin(), middle, areas.end());
  // A patch's edges are longer than the root of its area; a texel for each is what its light needs.
  if (atlas.density * std::sqrt(*middle) < 1) {
    progress.message(
        fmt::format("warning: the lightmap has {:.2g} texels per patch (median): its shadows are coarser than the "
                    "patches'; a larger "
                    "--lightmap-size keeps them",
                    atlas.density * atlas.density * *middle));
  }
  return atlas;
}

std::string lightmap_line(const Atlas& atlas) {
  return fmt::format("lightmap       {0} x {0} texels, {1} chart{2}, {3:.4g} texels per unit, padding {4}\n",
                     atlas.size, atlas.charts.list.size(), atlas.charts.list.size() == 1 ? "" : "s", atlas.density,
                     atlas.padding);
}

}  // namespace interflect::cli
