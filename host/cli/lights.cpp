#include "lights.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>

#include "interflect/solver/bounces.h"

namespace interflect::cli {

namespace {

constexpr std::size_t channels = 3;

std::vector<Rgb> by_patch(const Columns& columns, std::size_t group) {
  std::vector<Rgb> values(columns.front().size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    for (std::size_t c = 0; c < channels; ++c) values[i][c] = static_cast<double>(columns[channels * group + c][i]);
  }
  return values;
}

}  // namespace

void add_light_groups_option(CLI::App& command, std::string& by) {
  command
      .add_option("--light-groups", by,
                  "which lamps are switched together: object, material, auto, none, a list of names with * and ? "
                  "('desk*,ceiling'), or of groups with names ('warm=desk*,floor*;day=window*')")
      ->capture_default_str();
}

Light light_of(const PatchMesh& mesh, const LightGroups& groups) {
  const std::size_t n = mesh.size(), count = std::max<std::size_t>(1, groups.names.size());
  Light light{Columns(channels, std::vector<float>(n)), Columns(channels * count, std::vector<float>(n))};
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t group = groups.names.empty() ? 0 : groups.of_patch[i];
    for (std::size_t c = 0; c < channels; ++c) {
      light.reflectance[c][i] = static_cast<float>(mesh.reflectance[i][c]);
      if (group == LightGroups::none) continue;
      light.emittance[channels * group + c][i] = static_cast<float>(mesh.emittance[i][c]);
    }
  }
  return light;
}

Columns sum_of_groups(const Columns& columns) {
  Columns sum(channels, std::vector<float>(columns.front().size()));
  for (std::size_t c = 0; c < channels; ++c) {
    for (std::size_t i = 0; i < sum[c].size(); ++i) {
      double value = 0;
      for (std::size_t k = c; k < columns.size(); k += channels) value += static_cast<double>(columns[k][i]);
      sum[c][i] = static_cast<float>(value);
    }
  }
  return sum;
}

LitPatches lit_patches(const Columns& radiosity, const LightGroups& groups) {
  LitPatches lit;
  lit.all = by_patch(sum_of_groups(radiosity), 0);
  for (std::size_t g = 0; g < groups.names.size(); ++g) lit.by_group.push_back(by_patch(radiosity, g));
  return lit;
}

std::vector<std::vector<std::vector<Rgb>>> bounces_of(Scheduler& scheduler, const Light& light, std::uint32_t count,
                                                      ProgressSink* progress) {
  std::vector<std::vector<std::vector<Rgb>>> bounces;
  for (const Columns& columns : bounce_series(scheduler, light.reflectance, light.emittance, count, progress)) {
    std::vector<std::vector<Rgb>>& groups = bounces.emplace_back();
    for (std::size_t g = 0; g < columns.size() / channels; ++g) groups.push_back(by_patch(columns, g));
  }
  return bounces;
}

std::vector<GroupResidual> group_residuals(const PatchMesh& mesh, const LightGroups& groups,
                                           const std::vector<double>& relative_residual) {
  std::vector<GroupResidual> residuals;
  for (std::size_t g = 0; g < groups.names.size(); ++g) {
    residuals.push_back({groups.names[g], 0, {}, {}});
    for (std::size_t c = 0; c < channels; ++c) {
      residuals[g].relative_residual[c] = relative_residual.at(channels * g + c);
    }
  }
  if (residuals.empty()) return residuals;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (groups.of_patch[i] == LightGroups::none) continue;
    GroupResidual& group = residuals[groups.of_patch[i]];
    ++group.patches;
    for (std::size_t c = 0; c < channels; ++c) group.emitted[c] += mesh.area[i] * mesh.emittance[i][c];
  }
  return residuals;
}

std::vector<double> worst_of_groups(const std::vector<double>& relative_residual) {
  std::vector<double> worst(std::min(channels, relative_residual.size()));
  for (std::size_t k = 0; k < relative_residual.size(); ++k) {
    double& so_far = worst[k % channels];  // what is no number is the worst, and stays
    if (!std::isnan(so_far) && !(relative_residual[k] <= so_far)) so_far = relative_residual[k];
  }
  return worst;
}

}  // namespace interflect::cli
