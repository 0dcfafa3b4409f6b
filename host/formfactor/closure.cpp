#include "interflect/formfactor/closure.h"

#include <algorithm>
#include <cmath>

#include "interflect/formfactor/simd.h"

namespace interflect {

namespace {

/// F_ij ← d_i F_ij d_j.
void apply(FormFactorMatrix& f, const std::vector<float>& d, Scaling& report) {
  double max_change = 0;
  std::uint32_t moved = 0;
#pragma omp parallel for schedule(static) reduction(max : max_change) reduction(+ : moved)
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    const auto [low, high] = simd::scale(f.row(i), d[i], d);
    if (low > high) continue;  // an empty row
    const double mine = static_cast<double>(d[i]);
    const double change =
        std::max(std::abs(mine * static_cast<double>(low) - 1), std::abs(mine * static_cast<double>(high) - 1));
    max_change = std::max(max_change, change);
    moved += change > moved_much ? 1 : 0;
  }
  report.max_change = max_change;
  report.moved = moved;
}

}  // namespace

Scaling scale_to_closure(FormFactorMatrix& f, const std::vector<bool>& takes_part, double tolerance,
                         std::uint32_t most) {
  Scaling report;
  const std::uint32_t n = f.size();
  std::vector<double> sum(n), d(n, 1.0);
  std::vector<float> x(n, 1.0F);
  for (;; ++report.iterations) {
    double residual = 0;
#pragma omp parallel for schedule(static) reduction(max : residual)
    for (std::uint32_t i = 0; i < n; ++i) {
      sum[i] = d[i] * simd::dot(f.row(i), x);  // d_i (F d)_i
      if (takes_part[i]) residual = std::max(residual, std::abs(sum[i] - 1));
    }
    report.residual = residual;
    if (residual <= tolerance || report.iterations == most) break;
    const double omega = report.iterations % 2 == 0 ? 0.5 : 1;
    for (std::uint32_t i = 0; i < n; ++i) {
      if (!takes_part[i] || !(sum[i] > 0)) continue;
      d[i] *= std::pow(sum[i], -omega);
      x[i] = static_cast<float>(d[i]);
    }
  }
  apply(f, x, report);
  return report;
}

Scaling cap_row_sums(FormFactorMatrix& f, const std::vector<double>& row_sums) {
  Scaling report;
  std::vector<float> d(f.size(), 1.0F);
  bool any = false;
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    if (!(row_sums[i] > 1)) continue;
    d[i] = static_cast<float>((1 - 1e-7) / row_sums[i]);
    any = true;
  }
  if (!any) return report;
  report.iterations = 1;
  apply(f, d, report);
  return report;
}

}  // namespace interflect
