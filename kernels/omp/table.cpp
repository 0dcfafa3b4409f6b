#include "omp/table.h"

#include <utility>

namespace interflect::omp {

Function find_function(std::string_view name) {
  static constexpr std::pair<std::string_view, Function> functions[] = {
      {"copy", &copy},
      {"read", &read},
      {"matvec", &matvec},
      {"matvec_exact", &matvec_exact},
      {"close_rows", &close_rows},
      {"shadow_rays", &shadow_rays},
      {"scale", &scale},
      {"tiles16", &tiles16},
      {"sym16", &sym16},
      {"sym16_fold", &sym16_fold},
      {"dot", &dot},
      {"reduce", &reduce},
      {"axpby", &axpby},
      {"bounce", &bounce},
      {"cg_product", &cg_product},
      {"cg_step", &cg_step},
      {"bicgstab_product", &bicgstab_product},
      {"bicgstab_half", &bicgstab_half},
      {"bicgstab_step", &bicgstab_step},
  };
  for (const auto& [known, function] : functions) {
    if (known == name) return function;
  }
  return nullptr;
}

}  // namespace interflect::omp
