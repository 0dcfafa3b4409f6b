#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/base/vec3.h"
#include "interflect/scene/light_groups.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/scene.h"

namespace interflect {

struct Lightmap;

/// What a solve leaves, ready to be written: one radiosity and one row sum per patch.
struct Solution {
  const PatchMesh* mesh = nullptr;
  Grouping grouping;
  std::vector<Rgb> radiosity;   ///< B_i
  std::vector<double> row_sum;  ///< Σ_j F_ij
  LightGroups lights = {};      ///< no names: the lamps were not told apart
  /// lit[g]: the radiosities with group g alone, at full weight; they sum to `radiosity`.
  std::vector<std::vector<Rgb>> lit = {};
  /// bounces[k][g]: what group g's light is after 0, 1, 2, ... bounces, Σ_{m<=k} (diag(ρ) F)^m E_g; empty: not known.
  std::vector<std::vector<std::vector<Rgb>>> bounces = {};
};

/// Radiosities at the corners of every patch, [N][3], so that shading is smooth across a surface but not across its
/// edges: at vertex v of patch i, Σ_j A_j B_j / Σ_j A_j over the patches j that continue i's surface around v. Those
/// are reached from i over edges at v, step by step, between patches of the same material (or equal ρ and E), either
/// both emitting or both not, with normals within `crease` radians; a wall that stands on such an edge ends the surface
/// there. The two sides of a two-sided triangle never mix.
/// A vertex that hangs in the middle of a coarser neighbour's edge, as subdivision leaves it between triangles of
/// different size, gets the mean of the edge's ends, so that no crack shows; a vertex that the model itself left
/// elsewhere on an edge does not.
/// Light does not mix across a wall that stands on a patch's edge or goes through the patch, whether it shares vertices
/// with it or not: a patch that goes on under a wall takes part only at corners whose side is nearly the whole of it.
/// Patches without a finite radiosity are left out of the mean. Throws an internal Error unless there is one radiosity
/// per patch.
[[nodiscard]] std::vector<std::array<Rgb, 3>> corner_radiosities(const PatchMesh& mesh,
                                                                 const std::vector<Rgb>& radiosity,
                                                                 double crease = 0.8);

/// How exposed radiosity becomes what a screen shows (see tone.h). Both keep the hue.
enum class ToneMap {
  linear,  ///< as it is, up to 1
  filmic,  ///< Narkowicz's fit of the ACES curve: dark tones gain contrast, bright ones fade into white slowly
};

struct PictureOptions {
  std::optional<Camera> camera;  ///< none: frame_scene()
  std::uint32_t width = 1280, height = 720;
  /// Factor on the radiosity before the tone curve; none: from the picture's own values, so that surfaces that do not
  /// emit use the screen's range while lamps may clip.
  std::optional<double> exposure;
  ToneMap tone = ToneMap::filmic;
  /// Per pixel, stratified. A pixel whose first 4 see one patch, or one surface in one colour (within 2 %), gets no
  /// more.
  std::uint32_t samples = 16;
};

/// A picture, row 0 at the top, three channels per pixel.
struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<float> pixels;  ///< linear radiosity, mean over the pixel
  double exposure = 1;        ///< the factor that the options or the values gave
  /// What a screen shows, linear in 0..1: each sample exposed and tone-mapped by `tone` before the mean, so that the
  /// edges of lamps are smooth too. May be empty in a picture that was not rendered.
  std::vector<float> display;
  ToneMap tone = ToneMap::filmic;
};

/// A camera that shows the scene: from inside when the surfaces enclose a room, else from outside where most fronts
/// are seen. Positions are tried and scored by what rays from them meet, so that it stands in free space, away from
/// walls, never in furniture or behind a back, and looks at the side with the most different things to see.
/// The mesh does not say which way is up. Lamps decide if they shine mostly along y or z (light comes from above);
/// else z is up when the scene is flatter along z than along x and y; else y. Deterministic.
[[nodiscard]] Camera frame_scene(const PatchMesh& mesh, double aspect);

/// The picture of a solution. Backs of surfaces are not there: one looks through the back of a wall into the room.
/// Where nothing is met the picture is black. Radiosities that are not finite, or negative, show black.
/// Throws a usage Error for a size of 0 or above 32,768, no samples, an exposure that is not finite and positive, or a
/// camera that does not look anywhere.
[[nodiscard]] Picture render(const Solution& solution, const PictureOptions& options, ProgressSink* progress = nullptr);

/// Writers. The file appears whole under its final name or not at all; an input Error names it otherwise.

/// 8-bit sRGB, marked as such.
void write_png(const Picture& picture, ToneMap tone, const std::filesystem::path& path);
/// OpenEXR: R, G, B as half floats, linear radiosity without exposure (largest half: 65,504), Rec. 709 primaries.
void write_exr(const Picture& picture, const std::filesystem::path& path);
/// Patch mesh with colours at the vertices, binary little-endian PLY; faces in patch order. Per vertex: x y z, nx ny nz
/// (float), red green blue (uchar: sRGB of exposed radiosity, for viewers), radiosity_r radiosity_g radiosity_b (float:
/// linear radiosity). A vertex appears once for each surface that meets there.
void write_ply(const Solution& solution, const std::filesystem::path& path);
/// glTF 2.0 binary; a node with its mesh for each group that has patches, triangles in patch order, unlit material. A
/// patch is one triangle, or several where its neighbours have vertices on its edges (joints.h), so that no gap shows.
/// _RADIOSITY is the linear radiosity, _EMITTANCE the emittance (in groups with lamps only), _GROUP_0, _GROUP_1, ...
/// those of Solution::lit, whose names are in the scene's extras as "interflect_light_groups". COLOR_0 is linear too,
/// but glTF demands 0..1: it is the radiosity times color_scale() (tone.h), hue-preserving clip at 1; the factor is in
/// the scene's extras as "interflect_color_scale". With a lightmap the light is the material's texture instead of
/// COLOR_0 (glTF multiplies the two): an embedded 8-bit PNG with the same factor. TEXCOORD_1 are its coordinates, and
/// so are TEXCOORD_0, which glTF demands before; the extras have "interflect_lightmap". See lightmap.h.
void write_glb(const Solution& solution, const std::filesystem::path& path, const Lightmap* lightmap = nullptr);
/// One header line, then one line per patch: index,group,area,cx,cy,cz,nx,ny,nz,rho_r..b,e_r..b,b_r..b,row_sum.
/// Numbers round-trip. The group is its name (control characters become spaces), quoted when it must be.
void write_csv(const Solution& solution, const std::filesystem::path& path);
/// NumPy: float32 [N, 3], the radiosities in patch order.
void write_npy(const Solution& solution, const std::filesystem::path& path);

}  // namespace interflect
