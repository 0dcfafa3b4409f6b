#pragma once

#include <functional>
#include <span>
#include <vector>

#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/solver/solver.h"

namespace interflect {

/// The error of a radiosity b that was solved with a rounded F (the Scheduler's, in a 16-bit format), against the F of
/// dense32: max |δ| / max |b| over all patches and columns, where (I − diag(ρ)F) δ = e − (I − diag(ρ)F) b. The right
/// side is formed with dense32 in double, one pass over it (exact_dense: y = F x); δ is solved with the rounded F and
/// the method to one per cent, which is as good since δ is small. Of light groups, which repeat the columns of the
/// reflectances, each is held against its own largest radiosity, and the worst counts. What b itself was not converged
/// to is part of it. NaN when δ could not be solved for. Throws what solve() throws.
[[nodiscard]] double rounding_error(
    Scheduler& scheduler, Method method,
    const std::function<void(const Columns& x, std::vector<std::vector<double>>& y)>& exact_dense,
    std::span<const double> area, const Columns& reflectance, const Columns& emittance, const Columns& radiosity);
/// With the dense32 matrix at hand.
[[nodiscard]] double rounding_error(Scheduler& scheduler, Method method, const FormFactorMatrix& form_factors,
                                    std::span<const double> area, const Columns& reflectance, const Columns& emittance,
                                    const Columns& radiosity);

}  // namespace interflect
