#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "interflect/output/smooth.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// Patches with their radiosity at the corners: a solved scene as a GLB file keeps it.
struct LitMesh {
  PatchMesh mesh;  ///< reflectance is not known: 0
  SmoothMesh smooth;
  std::vector<Rgb> radiosity;  ///< per smooth vertex
};

/// A GLB that write_glb() wrote: attributes POSITION and _RADIOSITY, _EMITTANCE where there are lamps. Nothing when the
/// file is not one of ours: no primitive has _RADIOSITY, and another program wrote it. Throws an input Error that names
/// mesh and attribute when it is ours but damaged: no _RADIOSITY, another number or type of values than positions, a
/// value that is not finite or negative, an index out of range, a node that was moved,
/// far more values than the file has bytes, no patch with an area.
[[nodiscard]] std::optional<LitMesh> read_solved_glb(const std::filesystem::path& path);

}  // namespace interflect
