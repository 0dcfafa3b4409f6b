#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/output/atlas.h"

namespace interflect::cli {

/// What a command that writes a .glb says of its lightmap.
struct LightmapOptions {
  bool wanted = false;
  AtlasOptions atlas;
  std::vector<std::string> images;  ///< files beside the .glb
};
void add_lightmap_options(CLI::App& command, LightmapOptions& options);

/// Before the work starts. Throws a usage Error for a lightmap without a .glb among the outputs and for an image that
/// is not .exr or .png, a limit Error for a size that the memory does not hold.
void check_lightmap(const LightmapOptions& options, const std::vector<std::string>& outputs);

/// The charts in their image, or nothing where no lightmap is wanted. Warns of one that is coarser than the patches.
/// Throws a limit Error when they do not fit.
[[nodiscard]] std::optional<Atlas> lightmap_atlas(const LightmapOptions& options, const PatchMesh& mesh,
                                                  ProgressSink& progress);

/// "lightmap       1024 x 1024 texels, 12 charts, 82.1 texels per unit, padding 2", as a line of solve's summary.
[[nodiscard]] std::string lightmap_line(const Atlas& atlas);

}  // namespace interflect::cli
