#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "interflect/output/atlas.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"

namespace interflect {

/// The light of a solution as one image over an atlas.
struct Lightmap {
  Atlas atlas;
  std::vector<float> pixels;  ///< linear radiosity, three channels, rows from the top
  double scale = 1;           ///< color_scale(): what the images for screens multiply the radiosity by
};

/// The radiosity, interpolated over each patch from its corners (of a patch under a wall from those on the texel's side
/// of it), at each texel's centre that is in a chart; at a
/// texel's centre outside, up to padding + 1 texels away in both directions, that of the chart's nearest point; 0
/// elsewhere. O(texels + patches * (padding + 1)²). The same bits whatever the threads.
[[nodiscard]] Lightmap bake_lightmap(const Solution& solution, Atlas atlas);

/// The same for values at the smooth vertices: rows of the image, 3 * size² floats.
[[nodiscard]] std::vector<float> bake_texels(const PatchMesh& mesh, const SmoothMesh& smooth, const Atlas& atlas,
                                             const std::vector<Rgb>& values);

/// A PNG file of `bits` (8 or 16) bits per channel, marked as sRGB: the radiosity times the scale, hue-preserving clip
/// at 1, sRGB-encoded.
[[nodiscard]] std::string lightmap_png(const Lightmap& lightmap, int bits);

/// By the extension: .exr (linear radiosity in half floats, not scaled) or .png (16 bits, see lightmap_png()). Throws a
/// usage Error for another one, an input Error when the file cannot be written.
void write_lightmap(const Lightmap& lightmap, const std::filesystem::path& path);

/// The bytes that baking and writing a lightmap of this size take, at most.
[[nodiscard]] std::uint64_t lightmap_bytes(std::uint32_t size);

}  // namespace interflect
