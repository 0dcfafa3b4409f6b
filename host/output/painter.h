#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "interflect/output/sight.h"
#include "interflect/output/smooth.h"

namespace interflect {

/// What an eye sees of a lit mesh: smoothly shaded radiosity.
class Painter {
 public:
  /// `value` is the radiosity per smooth vertex; what is not finite or negative shows black. The mesh must outlive it.
  Painter(const PatchMesh& mesh, SmoothMesh smooth, const std::vector<Rgb>& value);

  static constexpr std::uint32_t nothing = 0xFFFFFFFF;
  struct Sample {
    std::array<float, 3> radiosity{};
    std::uint32_t patch = nothing;
    std::uint32_t surface = nothing;  ///< shading is continuous within one, but for where it hides a part of itself
  };
  /// What is seen along each direction; fast where neighbours in the list are neighbours in the picture.
  void look(Vec3 eye, std::span<const Vec3> directions, std::span<Sample> samples) const;

  [[nodiscard]] bool lamp(std::uint32_t patch) const { return lamp_[patch] != 0; }
  [[nodiscard]] const PatchMesh& mesh() const { return mesh_; }

 private:
  [[nodiscard]] Sample shade(const Sight::Seen& seen) const;

  const PatchMesh& mesh_;
  Sight sight_;
  SmoothMesh smooth_;
  std::vector<std::array<float, 3>> value_;  ///< per smooth vertex
  std::vector<std::uint32_t> surface_;       ///< per patch
  std::vector<std::uint8_t> lamp_;           ///< per patch
};

}  // namespace interflect
