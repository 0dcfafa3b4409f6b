#include "interflect/formfactor/assembly.h"

namespace interflect {

FormFactorRows rows_of(const FormFactorMatrix& f) {
  return [&f](const RowVisitor& visit) {
    for (std::uint32_t i = 0; i < f.size(); ++i) visit(i, f.row(i));
  };
}

GroupFactors between(const FormFactorRows& f, const std::vector<double>& area,
                     const std::vector<std::uint32_t>& surface, const Grouping& grouping) {
  const std::size_t groups = grouping.names.size();
  GroupFactors out{grouping.names, std::vector<double>(groups),
                   std::vector<std::vector<double>>(groups, std::vector<double>(groups))};
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
    for (double& factor : out.factors[a]) factor = out.areas[a] > 0 ? factor / out.areas[a] : 0;
  }
  return out;
}

GroupFactors between(const FormFactorMatrix& f, const PatchMesh& mesh, const Grouping& grouping) {
  return between(rows_of(f), mesh.area, mesh.surface, grouping);
}

}  // namespace interflect
