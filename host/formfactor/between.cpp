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

FormFactorRows rows_of(const FormFactorMatrix& f) {
  return [&f](const RowVisitor& visit) {
    for (std::uint32_t i = 0; i < f.size(); ++i) visit(i, f.row(i));
  };
}

GroupFactors between(const FormFactorRows& f, const std::vector<double>& area,
                     const std::vector<std::uint32_t>& surface, const Grouping& grouping) {
  const std::size_t groups = grouping.names.size();
  GroupFactors out{grouping.names, std::vector<double>(groups),
                   std::vector<std::vector<double>>(groups, std::vector<double>(groups)), std::vector<double>(groups)};
  std::vector<std::uint32_t> group(area.size());
  for (std::size_t i = 0; i < area.size(); ++i) {
    group[i] = grouping.of_surface[surface[i]];
    out.areas[group[i]] += area[i];
  }
  f([&](std::uint32_t i, std::span<const float> row) {
    auto& sums = out.factors[group[i]];
    for (std::size_t j = 0; j < row.size(); ++j) sums[group[j]] += area[i] * static_cast<double>(row[j]);
  });
  for (std::size_t a = 0; a < groups; ++a) {
    double sum = 0;
    for (double& factor : out.factors[a]) sum += factor = out.areas[a] > 0 ? factor / out.areas[a] : 0;
    out.sky[a] = out.areas[a] > 0 ? std::max(0.0, 1 - sum) : 0;
  }
  leave_out(out, grouping.obstruction);
  return out;
}

GroupFactors between(const FormFactorMatrix& f, const PatchMesh& mesh, const Grouping& grouping) {
  return between(rows_of(f), mesh.area, mesh.surface, grouping);
}

}  // namespace interflect
