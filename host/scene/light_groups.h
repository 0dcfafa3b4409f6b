#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace interflect {

/// Which emitters are switched together: a solution B is linear in them, B = Σ_g w_g B_g for emittances Σ_g w_g E_g.
struct LightGroups {
  static constexpr std::uint32_t none = 0xFFFFFFFF;

  std::vector<std::string> names;       ///< one per group, in the order of the columns
  std::vector<std::uint32_t> of_patch;  ///< per patch: its group, or none where it does not emit
};

}  // namespace interflect
