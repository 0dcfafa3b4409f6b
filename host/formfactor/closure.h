#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

/// S x of the exchange areas S_ij = A_i F_ij, wherever they lie: x of n values to n values.
using ExchangeProduct = std::function<std::vector<double>(const std::vector<float>& x)>;

/// What a scaling of S to diag(d) S diag(d) did.
struct Scaling {
  std::vector<double> d;         ///< positive
  std::uint32_t iterations = 0;  ///< products with S
  double residual = 0;           ///< largest |row sum − 1| that is left among the rows that take part
  double max_change = 0;         ///< largest |d_i d_j − 1| over the nonzero factors: see make_form_factors()
};
/// A change of a factor, or of a row's sum, that a user should know of.
inline constexpr double moved_much = 0.05;

/// Brings the row sums of F to 1 by F_ij = d_i S_ij d_j / A_i, which keeps S symmetric, non-negative and its
/// zeros zero. Rows that do not take part keep d = 1; their columns count towards the sums of the others. Far from the
/// goal by d_i ← d_i (d_i (F d)_i)^−½; near it by Newton's method on ln d (Knight and Ruiz 2013), whose systems
/// conjugate gradients solve in a few products. Where F has the eigenvalue −1 (two plates that see only each other) the
/// system is singular but consistent: that direction changes no row sum, and the gradients never enter it. Stops at
/// |row sum − 1| <= tolerance, or when it has used `most` products.
[[nodiscard]] Scaling scale_to_closure(const ExchangeProduct& product, const std::vector<double>& area,
                                       const std::vector<bool>& takes_part, double tolerance, std::uint32_t most = 200);

/// Brings rows whose sum exceeds 1 down to at most 1, by d_i = 1 / row sum there and d_i = 1 elsewhere.
[[nodiscard]] Scaling cap_row_sums(const std::vector<double>& row_sums);

/// S x of a matrix that holds S; 0 in rows that it does not hold. The matrix must outlive what is returned.
[[nodiscard]] ExchangeProduct exchange_product(const FormFactorMatrix& s);

/// Σ_j F_ij = d_i (S d)_i / A_i for every i; 0 where the area is.
[[nodiscard]] std::vector<double> row_sums_of(const ExchangeProduct& product, const std::vector<double>& area,
                                              const std::vector<double>& d);

/// Turns a matrix that holds S into one that holds F, in place: F_ij = S_ij (d_i / A_i) d_j. Sets max_change, of the rows
/// that it holds.
void make_form_factors(FormFactorMatrix& s, const std::vector<double>& area, Scaling& scaling);

}  // namespace interflect
