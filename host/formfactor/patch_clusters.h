#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

/// One pass of patch_order(): the patches joined to pairs, fours, eights and sixteens, at each step those whose rows
/// have their non-zeros in the same groups of columns; columns are grouped, and partners looked for, along `order` (a
/// permutation of the patches). Returns the new order; each sixteen stands where its first patch stood, what is left
/// over (an eight, a four, a pair, a patch) at the end.
[[nodiscard]] std::vector<std::uint32_t> joined_by_view(const FormFactorMatrix& form_factors,
                                                        std::span<const std::uint32_t> order);

}  // namespace interflect
