#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "interflect/formfactor/kernel.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// The patches as the assembly reads them: one array per coordinate, moved so that the scene's box is centred on the
/// origin (single precision is then finest where it matters), padded to whole blocks with patches that face nothing.
struct PatchTable {
  static constexpr std::size_t block = 32;  ///< patches per block; a tile is block x block pairs

  std::size_t size = 0;
  Vec3 centre{};                              ///< where the origin was moved to
  double extent = 0;                          ///< largest absolute coordinate
  std::array<std::vector<double>, 9> corner;  ///< ax ay az bx by bz cx cy cz
  std::array<std::vector<double>, 9> node;    ///< the three quadrature points, likewise
  std::array<std::vector<double>, 3> normal;  ///< unit length
  std::array<std::vector<double>, 3> centroid;
  std::vector<double> offset;     ///< of the plane: normal·x = offset
  std::vector<double> radius;     ///< largest distance of a corner from the centroid
  std::vector<double> tolerance;  ///< what is nearer than this to the plane counts as on it
  std::vector<double> area;

  explicit PatchTable(const PatchMesh& mesh);

  [[nodiscard]] std::size_t blocks() const { return (size + block - 1) / block; }
  [[nodiscard]] std::array<Vec3, 3> triangle(std::size_t i) const;
  [[nodiscard]] kernel::Plane plane(std::size_t i) const;
  [[nodiscard]] Vec3 front(std::size_t i) const { return {normal[0][i], normal[1][i], normal[2][i]}; }
  /// Bytes that a table of n patches takes.
  [[nodiscard]] static std::uint64_t predicted_bytes(std::uint64_t n);
};

}  // namespace interflect
