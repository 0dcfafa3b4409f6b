#include <algorithm>

#include "interflect/formfactor/assembly.h"

namespace interflect {

namespace {

/// Takes the rows and columns of obstructions out.
void leave_out(GroupFactors& table, const std::vector<bool>& obstruction) {
  const auto keep = [&](auto& list) {
    std::size_t kept = 0;
    for (std::size_t g = 0; g < list.size(); ++g) {
      if (g >= obstruction.size() || !obstruction[g]) std::swap(list[kept++], list[g]);
    }
    list.resize(kept);
  };
  for (std::size_t g = 0; g < obstruction.size(); ++g) {
    if (obstruction[g]) table.left_out.push_back(table.groups[g]);
  }
  if (table.left_out.empty()) return;
  for (auto& row : table.factors) keep(row);
  keep(table.factors);
  keep(table.groups);
  keep(table.areas);
  keep(table.sky);
}

}  // namespace

GroupFactors between(const FormFactorMatrix& f, const PatchMesh& mesh, const Grouping& grouping) {
  const std::size_t groups = grouping.names.size();
  GroupFactors out{grouping.names, std::vector<double>(groups),
                   std::vector<std::vector<double>>(groups, std::vector<double>(groups)), std::vector<double>(groups)};
  std::vector<std::uint32_t> group(mesh.size());
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    group[i] = grouping.of_surface[mesh.surface[i]];
    out.areas[group[i]] += mesh.area[i];
  }
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    const auto row = f.row(i);
    auto& sums = out.factors[group[i]];
    for (std::size_t j = 0; j < row.size(); ++j) sums[group[j]] += mesh.area[i] * static_cast<double>(row[j]);
  }
  for (std::size_t a = 0; a < groups; ++a) {
    double sum = 0;
    for (double& factor : out.factors[a]) sum += factor = out.areas[a] > 0 ? factor / out.areas[a] : 0;
    out.sky[a] = out.areas[a] > 0 ? std::max(0.0, 1 - sum) : 0;
  }
  leave_out(out, grouping.obstruction);
  return out;
}

}  // namespace interflect
