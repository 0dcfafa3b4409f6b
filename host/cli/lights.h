#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "interflect/output/output.h"
#include "interflect/scene/light_groups.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/solver/solver.h"

// Lamps told apart: three columns of a solve for each light group.

namespace CLI {
class App;
}

namespace interflect::cli {

/// What a solve shall tell apart.
struct Lamps {
  LightGroups groups = {};  ///< no names: nothing, all lamps are on
  /// Also what the light is after 0, 1, ... so many bounces; none: not wanted.
  std::optional<std::uint32_t> bounces = {};
};

/// The option --light-groups, for light_groups().
void add_light_groups_option(CLI::App& command, std::string& by);

/// What a mesh gives the solver: a column per channel and, for the emittances, group: group g has the columns 3 g,
/// 3 g + 1 and 3 g + 2. Without groups there are three columns, of all lamps.
struct Light {
  Columns reflectance, emittance;
};
[[nodiscard]] Light light_of(const PatchMesh& mesh, const LightGroups& groups = {});

/// Radiosities by patch of such columns: those of every group, and their sum.
struct LitPatches {
  std::vector<Rgb> all;
  std::vector<std::vector<Rgb>> by_group;  ///< empty without groups
};
[[nodiscard]] LitPatches lit_patches(const Columns& radiosity, const LightGroups& groups);

/// The columns of all groups together: one per channel.
[[nodiscard]] Columns sum_of_groups(const Columns& columns);

/// bounce_series() by patch: [k][g], one g without groups.
[[nodiscard]] std::vector<std::vector<std::vector<Rgb>>> bounces_of(Scheduler& scheduler, const Light& light,
                                                                    std::uint32_t count, ProgressSink* progress);

/// A group in a report.
struct GroupResidual {
  std::string name;
  std::uint32_t patches = 0;
  Rgb emitted{};  ///< Σ A_i E_i
  std::array<double, 3> relative_residual{};
};
/// Of the residuals of all columns. Empty without groups.
[[nodiscard]] std::vector<GroupResidual> group_residuals(const PatchMesh& mesh, const LightGroups& groups,
                                                         const std::vector<double>& relative_residual);
/// The worst group's, per channel.
[[nodiscard]] std::vector<double> worst_of_groups(const std::vector<double>& relative_residual);

}  // namespace interflect::cli
