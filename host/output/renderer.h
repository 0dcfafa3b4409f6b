#pragma once

#include <memory>
#include <span>

#include "interflect/output/lit_mesh.h"
#include "interflect/output/output.h"

namespace interflect {

class Painter;

/// Pictures of one solution from many cameras. What does not depend on the camera (the hierarchy over the patches,
/// their smooth shading) is made once; the solution's mesh must outlive it. Safe to use from several threads.
class Renderer {
 public:
  /// With `walls` off, light and dark mix across walls under which patches go on (for comparison only). Throws an
  /// internal Error for a solution without a radiosity per patch.
  explicit Renderer(const Solution& solution, bool walls = true);
  explicit Renderer(const LitMesh& lit);
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;
  ~Renderer();

  /// The options' camera, else frame_scene().
  [[nodiscard]] Camera camera(const PictureOptions& options) const;
  /// The automatic exposure that suits all these cameras together: from what the surfaces that are not lamps show.
  [[nodiscard]] double exposure(const PictureOptions& options, std::span<const Camera> cameras) const;
  /// See interflect::render().
  [[nodiscard]] Picture render(const PictureOptions& options, ProgressSink* progress = nullptr) const;

 private:
  std::unique_ptr<Painter> painter_;
};

}  // namespace interflect
