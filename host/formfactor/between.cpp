#include "interflect/formfactor/assembly.h"

namespace interflect {

GroupFactors between(const FormFactorMatrix& f, const PatchMesh& mesh, const Grouping& grouping) {
  const std::size_t groups = grouping.names.size();
  GroupFactors out{grouping.names, std::vector<double>(groups),
                   std::vector<std::vector<double>>(groups, std::vector<double>(groups))};
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
    for (double& factor : out.factors[a]) factor = out.areas[a] > 0 ? factor / out.areas[a] : 0;
  }
  return out;
}

}  // namespace interflect
