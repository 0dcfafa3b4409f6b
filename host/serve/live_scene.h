#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "interflect/scene/light_groups.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/schedule/columns.h"

namespace interflect::serve {

/// What a request asks for, in full: what it does not name is as in the scene.
struct Change {
  std::map<std::size_t, Rgb> reflectance, emittance;  ///< by index into LiveScene::materials()
  double tolerance = 1e-4;
};

/// A material that patches are made of.
struct LiveMaterial {
  std::string name;                     ///< unique, never empty, UTF-8 on one line: clients name it in JSON
  std::vector<std::uint32_t> surfaces;  ///< of PatchMesh::surfaces
  std::uint64_t patches = 0;
  double area = 0;
  Rgb reflectance{}, emittance{};  ///< means over its area
  bool emits = false;              ///< some patch of it does
  bool varies = false;             ///< a texture makes its patches differ
};

/// What of a meshed scene can change while its form factors stay: reflectances and emittances by material. Where a
/// texture makes the patches of a material differ, a new value scales them, channel by channel, so that their mean is
/// the new value (no reflectance above 1); a channel in which all are 0, and a material without texture, take it as it
/// is. Only what emits in the scene can be given another emittance: the light groups stay.
class LiveScene {
 public:
  /// Names by Surface::material, may be shorter. The mesh must outlive this.
  LiveScene(const PatchMesh& mesh, LightGroups groups, const std::vector<std::string>& material_names);

  [[nodiscard]] const PatchMesh& mesh() const { return mesh_; }
  [[nodiscard]] const LightGroups& groups() const { return groups_; }
  [[nodiscard]] const std::vector<LiveMaterial>& materials() const { return materials_; }
  /// Light groups; 1 where they are not told apart.
  [[nodiscard]] std::size_t lamps() const { return groups_.names.empty() ? 1 : groups_.names.size(); }

  /// A column per channel.
  [[nodiscard]] Columns reflectance(const Change& change) const;
  /// A column per channel and light group: 3 g + channel.
  [[nodiscard]] Columns emittance(const Change& change) const;

 private:
  void collect();

  const PatchMesh& mesh_;
  LightGroups groups_;
  std::vector<LiveMaterial> materials_;
  std::vector<std::uint32_t> material_of_;  ///< by patch
};

}  // namespace interflect::serve
