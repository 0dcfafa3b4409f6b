#include "interflect/formfactor/closure.h"

#include <algorithm>
#include <cmath>

#include "interflect/formfactor/simd.h"

namespace interflect {

namespace {

/// The scaling problem in x = ln d: minimise ½ Σ e^{x_i + x_j} S_ij − Σ A_i x_i, which is convex.
/// Its gradient is A_i (r_i − 1) with the row sums r = d ∘ (F d), its Hessian diag(A r) + diag(d) S diag(d).
class Balance {
 public:
  Balance(const ExchangeProduct& product, const std::vector<double>& area, const std::vector<bool>& takes_part)
      : product_(product), area_(area), takes_part_(takes_part), d(area.size(), 1.0) {}

  /// Row sums at d; counts a product.
  void evaluate() {
    const std::vector<float> x(d.begin(), d.end());
    row_sum = product_(x);
    residual = 0;
    for (std::size_t i = 0; i < d.size(); ++i) {
      row_sum[i] = area_[i] > 0 ? row_sum[i] * d[i] / area_[i] : 0;
      if (takes_part_[i]) residual = std::max(residual, std::abs(row_sum[i] - 1));
    }
    ++products;
  }

  /// d ← d r^−½.
  void damped_step() {
    for (std::size_t i = 0; i < d.size(); ++i) {
      if (takes_part_[i] && row_sum[i] > 0) d[i] /= std::sqrt(row_sum[i]);
    }
  }

  /// One Newton step: conjugate gradients on the Hessian, preconditioned by its diagonal part, until the linear
  /// residual is a few percent of the present one. No component of ln d moves by more than 1.
  void newton_step(double target) {
    const std::size_t n = d.size();
    std::vector<double> step(n), r(n), z(n), p(n);
    double start = 0, rz = 0;
    for (std::size_t i = 0; i < n; ++i) {
      r[i] = takes_part_[i] ? area_[i] * (1 - row_sum[i]) : 0;
      z[i] = diagonal(i) > 0 ? r[i] / diagonal(i) : 0;
      p[i] = z[i];
      rz += r[i] * z[i];
    }
    start = rz;
    const double enough = std::max(0.03 * residual, 0.3 * target);
    for (int k = 0; k < 12 && rz > 0 && rz > 1e-6 * start; ++k) {
      const std::vector<double> hp = hessian(p);
      double php = 0;
      for (std::size_t i = 0; i < n; ++i) php += p[i] * hp[i];
      if (!(php > 0)) break;
      const double alpha = rz / php, old = rz;
      rz = 0;
      double left = 0;
      for (std::size_t i = 0; i < n; ++i) {
        step[i] += alpha * p[i];
        r[i] -= alpha * hp[i];
        z[i] = diagonal(i) > 0 ? r[i] / diagonal(i) : 0;
        rz += r[i] * z[i];
        left = std::max(left, std::abs(z[i]));
      }
      if (left < enough) break;
      for (std::size_t i = 0; i < n; ++i) p[i] = z[i] + rz / old * p[i];
    }
    for (std::size_t i = 0; i < n; ++i) d[i] *= std::exp(std::clamp(step[i], -1.0, 1.0));
  }

 private:
  const ExchangeProduct& product_;
  const std::vector<double>& area_;
  const std::vector<bool>& takes_part_;

  [[nodiscard]] double diagonal(std::size_t i) const { return takes_part_[i] ? area_[i] * row_sum[i] : 0; }

  std::vector<double> hessian(const std::vector<double>& p) {
    std::vector<float> x(p.size());
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = static_cast<float>(takes_part_[i] ? d[i] * p[i] : 0);
    std::vector<double> out = product_(x);
    for (std::size_t i = 0; i < x.size(); ++i) {
      out[i] = takes_part_[i] ? diagonal(i) * p[i] + d[i] * out[i] : 0;
    }
    ++products;
    return out;
  }

 public:
  std::vector<double> d, row_sum;
  double residual = 0;
  std::uint32_t products = 0;
};

}  // namespace

Scaling scale_to_closure(const ExchangeProduct& product, const std::vector<double>& area,
                         const std::vector<bool>& takes_part, double tolerance, std::uint32_t most) {
  Balance balance(product, area, takes_part);
  balance.evaluate();
  Scaling report;
  report.d = balance.d;
  double least = balance.residual;
  // Far from the goal the damped step is the safe one, near it Newton's is the fast one. A goal that cannot be reached
  // (two patches of unequal area that see only each other) ends by not coming nearer.
  for (int k = 0, idle = 0; balance.residual > tolerance && balance.products < most && idle < 4; ++k) {
    if (k < 2 && balance.residual > 0.2) {
      balance.damped_step();
    } else {
      balance.newton_step(tolerance);
    }
    balance.evaluate();
    idle = balance.residual < 0.9 * least ? 0 : idle + 1;
    if (balance.residual < least) {
      least = balance.residual;
      report.d = balance.d;
    }
  }
  report.iterations = balance.products - 1;
  report.residual = least;
  return report;
}

Scaling cap_row_sums(const std::vector<double>& row_sums) {
  Scaling report;
  report.d.assign(row_sums.size(), 1.0);
  for (std::size_t i = 0; i < row_sums.size(); ++i) {
    if (!(row_sums[i] > 1)) continue;
    report.d[i] = (1 - 1e-7) / row_sums[i];
    report.iterations = 1;
  }
  return report;
}

ExchangeProduct exchange_product(const FormFactorMatrix& s) {
  return [&s](const std::vector<float>& x) {
    std::vector<double> y(s.size());
#pragma omp parallel for schedule(static)
    for (std::uint32_t i = s.first_row(); i < s.end_row(); ++i) y[i] = simd::dot(s.row(i), x);
    return y;
  };
}

std::vector<double> row_sums_of(const ExchangeProduct& product, const std::vector<double>& area,
                                const std::vector<double>& d) {
  std::vector<double> sums = product({d.begin(), d.end()});
  for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = area[i] > 0 ? sums[i] * d[i] / area[i] : 0;
  return sums;
}

void make_form_factors(FormFactorMatrix& s, const std::vector<double>& area, Scaling& scaling) {
  const std::vector<double>& d = scaling.d;
  const std::vector<float> x(d.begin(), d.end());
  double max_change = 0;
#pragma omp parallel for schedule(static) reduction(max : max_change)
  for (std::uint32_t i = s.first_row(); i < s.end_row(); ++i) {
    const auto [low, high] = simd::scale(s.row(i), area[i] > 0 ? static_cast<float>(d[i] / area[i]) : 0.0F, x);
    if (low > high) continue;  // an empty row
    max_change = std::max(
        {max_change, std::abs(d[i] * static_cast<double>(low) - 1), std::abs(d[i] * static_cast<double>(high) - 1)});
  }
  scaling.max_change = max_change;
}

}  // namespace interflect
