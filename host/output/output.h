#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/scene.h"

namespace interflect {

/// What a solve leaves, ready to be written: one radiosity and one row sum per patch.
struct Solution {
  const PatchMesh* mesh = nullptr;
  Grouping grouping;
  std::vector<Rgb> radiosity;   ///< B_i
  std::vector<double> row_sum;  ///< Σ_j F_ij
};

/// Radiosities at the corners of every patch, so that shading is smooth across a surface but not across its edges: the
/// area-weighted mean of the patches around the vertex that continue the same surface (same material and side, normals
/// within `crease` radians, connected through shared edges or vertices).
[[nodiscard]] std::vector<std::array<Rgb, 3>> corner_radiosities(const PatchMesh& mesh,
                                                                 const std::vector<Rgb>& radiosity,
                                                                 double crease = 0.6);

enum class ToneMap { linear, filmic };

struct PictureOptions {
  std::optional<Camera> camera;  ///< none: frame_scene()
  std::uint32_t width = 1280, height = 720;
  std::optional<double>
      exposure;  ///< factor on the radiosity before the tone curve; none: from the picture's own values
  ToneMap tone = ToneMap::filmic;
  std::uint32_t samples = 16;  ///< per pixel
};

/// Linear radiosity per pixel, row 0 at the top, three channels; and the exposure that the options or the values give.
struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<float> pixels;
  double exposure = 1;
};

/// A camera that shows the scene from inside when it encloses its surfaces, else from outside where most fronts are
/// seen.
[[nodiscard]] Camera frame_scene(const PatchMesh& mesh, double aspect);

/// The picture of a solution. Backs of surfaces show black when the patch's front cannot be seen.
[[nodiscard]] Picture render(const Solution& solution, const PictureOptions& options);

/// Writers. The file appears whole under its final name or not at all; an input Error names it otherwise.
void write_png(const Picture& picture, ToneMap tone, const std::filesystem::path& path);  ///< 8-bit sRGB
void write_exr(const Picture& picture, const std::filesystem::path& path);                ///< linear, half floats
/// Patch mesh with linear vertex colours: binary PLY with float red, green, blue and 8-bit copies for viewers.
void write_ply(const Solution& solution, const std::filesystem::path& path);
/// glTF 2.0 binary, COLOR_0 as linear floats, unlit material, one node per group.
void write_glb(const Solution& solution, const std::filesystem::path& path);
/// index, group, area, cx, cy, cz, nx, ny, nz, rho_r..b, e_r..b, b_r..b, row_sum; one line per patch.
void write_csv(const Solution& solution, const std::filesystem::path& path);
/// float32 [N, 3], the radiosities in patch order.
void write_npy(const Solution& solution, const std::filesystem::path& path);

}  // namespace interflect
