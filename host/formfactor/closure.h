#pragma once

#include <cstdint>
#include <vector>

#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

/// What a scaling of S to diag(d) S diag(d) did.
struct Scaling {
  std::uint32_t iterations = 0;      ///< products with F
  double residual = 0;               ///< largest |row sum − 1| that is left among the rows that take part
  double max_change = 0;             ///< largest |d_i d_j − 1| over the nonzero factors
  std::vector<std::uint32_t> moved;  ///< the rows with |d_i − 1| above moved_much
};
inline constexpr double moved_much = 0.05;

/// Brings the row sums of F to 1 by F_ij ← d_i F_ij d_j, which keeps S = diag(A) F symmetric, non-negative and its
/// zeros zero. Rows that do not take part keep d = 1; their columns count towards the sums of the others. Far from the
/// goal by d_i ← d_i (d_i (F d)_i)^−½; near it by Newton's method on ln d (Knight and Ruiz 2013), whose systems
/// conjugate gradients solve in a few products. Where F has the eigenvalue −1 (two plates that see only each other) the
/// system is singular but consistent: that direction changes no row sum, and the gradients never enter it. Stops at
/// |row sum − 1| <= tolerance, or when it has used `most` products with F.
[[nodiscard]] Scaling scale_to_closure(FormFactorMatrix& f, const std::vector<double>& area,
                                       const std::vector<bool>& takes_part, double tolerance, std::uint32_t most = 200);

/// Brings rows whose sum exceeds 1 down to at most 1, by d_i = 1 / row sum there and d_i = 1 elsewhere.
[[nodiscard]] Scaling cap_row_sums(FormFactorMatrix& f, const std::vector<double>& row_sums);

}  // namespace interflect
