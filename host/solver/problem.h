#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "interflect/schedule/scheduler.h"
#include "interflect/solver/solver.h"

namespace interflect {

/// What solve() was given, checked: the right-hand side in double, its norms, and the residual of a result.
class Problem {
 public:
  /// Throws as solve() says.
  Problem(Scheduler& scheduler, std::span<const double> area, const Columns& reflectance, const Columns& emittance);

  [[nodiscard]] const Columns& reflectance() const { return reflectance_; }
  /// ‖e‖₂ of every column.
  [[nodiscard]] const std::vector<double>& norms() const { return norms_; }
  /// A_i/ρ_i over the mean area, 0 where ρ_i = 0 (or is so small that its bounce is far below rounding).
  [[nodiscard]] Columns weight() const;

  /// r = e − b + ρ∘(F b), in double: one product.
  void residual(const Columns& b, std::vector<std::vector<double>>& r) const;
  /// ‖r‖₂ / ‖e‖₂ of a column; ‖r‖₂ itself where e = 0.
  [[nodiscard]] double relative(const std::vector<double>& r, std::size_t column) const;

 private:
  Scheduler& scheduler_;
  std::span<const double> area_;
  const Columns& reflectance_;
  const Columns& emittance_;
  std::vector<double> norms_;
};

}  // namespace interflect
