#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/scene.h"

namespace interflect {

/// Which emitters are switched together: a solution B is linear in them, B = Σ_g w_g B_g for emittances Σ_g w_g E_g.
struct LightGroups {
  static constexpr std::uint32_t none = 0xFFFFFFFF;

  std::vector<std::string> names;       ///< one per group, in the order of the columns
  std::vector<std::uint32_t> of_patch;  ///< per patch: its group, or none where it does not emit
};

/// More light groups than this are refused: every one is three columns of a solve.
inline constexpr std::size_t most_light_groups = 256;

/// The groups of the mesh's emitters (patches whose emittance is not zero in every channel):
///   object    by Surface::object (a glTF node's name), whatever the materials; without one by Surface::group, without
///             that by the material. What a file calls by one name is one group: to switch two lamps apart, name them
///             apart;
///   material  by the material's name;
///   auto      object; material where that are more than 24 groups; none where those are more, too;
///   none      not told apart: no names, and every patch's group is none;
///   LIST      "desk,ceiling*": one group for each pattern, or "warm=desk,floor*;day=window_?": a name, and the
///   patterns
///             of what belongs to it. A pattern is an object's, a group's or a material's name; * stands for any
///             characters and ? for one. An emitter is of the first group that takes it; those that none takes are one
///             more, at the end.
/// Names are unique, never empty, and on one line; the groups are in the order of their first patch (of the list).
/// Throws a usage Error for a list that is malformed, has a name twice, or has a pattern that takes no emitter (it says
/// what the emitters are called), and a limit Error for more than most_light_groups.
[[nodiscard]] LightGroups light_groups(const Scene& scene, const PatchMesh& mesh, std::string_view by);

}  // namespace interflect
