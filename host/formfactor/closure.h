#pragma once

#include <cstdint>
#include <vector>

#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

/// What a scaling of S to diag(d) S diag(d) did.
struct Scaling {
  std::uint32_t iterations = 0;
  double residual = 0;      ///< largest |row sum − 1| that is left among the rows that take part
  double max_change = 0;    ///< largest |d_i d_j − 1| over the nonzero factors
  std::uint32_t moved = 0;  ///< rows with a factor moved by more than moved_much
};
inline constexpr double moved_much = 0.05;

/// Brings the row sums of F to 1 by F_ij ← d_i F_ij d_j, which keeps S = diag(A) F symmetric, non-negative and its
/// zeros zero. Rows that do not take part keep d = 1; their columns count towards the sums of the others. d_i ← d_i
/// (d_i (F d)_i)^−ω with ω = 1/2 and 1 in turn: near the solution an error along an eigenvalue λ of F shrinks by (1 −
/// λ)/2 and then by −λ, so nothing grows, and along λ = −1 (two plates that see only each other), where it would not
/// shrink, the row sums do not depend on it. Stops at |row sum − 1| <= tolerance or after most iterations.
[[nodiscard]] Scaling scale_to_closure(FormFactorMatrix& f, const std::vector<bool>& takes_part, double tolerance,
                                       std::uint32_t most = 200);

/// Brings rows whose sum exceeds 1 down to at most 1, by d_i = 1 / row sum there and d_i = 1 elsewhere.
[[nodiscard]] Scaling cap_row_sums(FormFactorMatrix& f, const std::vector<double>& row_sums);

}  // namespace interflect
