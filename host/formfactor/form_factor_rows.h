#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

/// Visits the rows of F in order, wherever they lie: n elements each, valid during the call.
using RowVisitor = std::function<void(std::uint32_t i, std::span<const float> row)>;
using FormFactorRows = std::function<void(const RowVisitor& visit)>;

/// The rows of a matrix. It must outlive what is returned.
[[nodiscard]] FormFactorRows rows_of(const FormFactorMatrix& f);

}  // namespace interflect
