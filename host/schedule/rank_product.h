#pragma once

#include <cstdint>
#include <memory>

#include "interflect/base/ranks.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/product.h"

namespace interflect {

/// y = F x where each rank has some rows of F (form_factors of first_row() to end_row(); all ranks' rows are all rows,
/// in their order, and one rank may have none): the rank's own device takes its rows, and all_gather() brings y
/// together on every rank. A row's sum depends on the row, x and the kernel alone: with equal devices y has the same
/// bits for every number of ranks. Where the devices (or how they are tuned) differ, apply() first gives every rank
/// rank 0's x, so that the ranks never part. Collective.
[[nodiscard]] std::unique_ptr<Product> make_product(const FormFactorMatrix& form_factors, Ranks& ranks, Device& device,
                                                    const VectorArguments& shape, std::uint32_t groups);

}  // namespace interflect
