#pragma once

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "interflect/base/error.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect::fuzzing {

[[noreturn]] inline void found(const char* what, const char* detail = "") {
  std::fprintf(stderr, "finding: %s %s\n", what, detail);
  std::abort();
}

/// What every reader promises of the scene that it returns, and what follows a reader in `solve`.
inline void use(const Scene& scene) {
  for (const Vec3 p : scene.positions) {
    if (!finite(p)) found("a coordinate that is not finite");
  }
  for (const std::string& warning : scene.warnings) {
    if (warning.find('\n') != std::string::npos) found("a warning of several lines");
  }
  for (const Finding& finding : check_scene(scene)) {
    if (finding.line().empty() || finding.line().find('\n') != std::string::npos) found("a finding without its line");
  }
  (void)group_surfaces(scene);
  SubdivideOptions options;
  options.divide = choose_divide(scene, 200);
  options.max_patches = 5000;
  const PatchMesh mesh = subdivide(scene, options);
  if (mesh.size() == 0 || mesh.size() != count_patches(scene, options.divide)) found("patches miscounted");
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (!(mesh.area[i] >= 0) || !finite(mesh.centroid[i]) || !finite(mesh.normal[i])) found("a patch without sense");
    for (const std::uint32_t v : mesh.corners[i]) {
      if (v >= mesh.vertices.size()) found("a patch's corner out of range");
    }
  }
}

/// Errors that a bad file may give: an input Error, or a limit that it runs into. All else, and every other exception,
/// is a finding.
template <typename Action>
int run(const std::uint8_t* data, std::size_t size, const Action& action) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  try {
    action(text);
  } catch (const Error& error) {
    const std::string message = error.what();
    if (error.kind() != ErrorKind::input && error.kind() != ErrorKind::limit)
      found("an error of its kind:", error.what());
    if (message.empty() || message.find('\n') != std::string::npos) found("a message that is not one line");
  }
  return 0;
}

}  // namespace interflect::fuzzing
