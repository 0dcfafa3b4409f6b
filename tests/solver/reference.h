#pragma once

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/scheduler.h"

// The fp64 reference: serial loops that anyone can check by eye.

namespace interflect::test {

using Doubles = std::vector<std::vector<double>>;

/// Solves (I − diag(ρ) F) b = e by Gaussian elimination with partial pivoting, a column at a time.
inline Doubles reference_solution(const FormFactorMatrix& f, const Columns& rho, const Columns& e) {
  const std::size_t n = f.size();
  Doubles b;
  for (std::size_t c = 0; c < e.size(); ++c) {
    Doubles a(n, std::vector<double>(n + 1));
    for (std::size_t i = 0; i < n; ++i) {
      const auto row = f.row(static_cast<std::uint32_t>(i));
      for (std::size_t j = 0; j < n; ++j) {
        a[i][j] = (i == j ? 1.0 : 0.0) - static_cast<double>(rho[c][i]) * static_cast<double>(row[j]);
      }
      a[i][n] = static_cast<double>(e[c][i]);
    }
    for (std::size_t k = 0; k < n; ++k) {
      std::size_t pivot = k;
      for (std::size_t i = k + 1; i < n; ++i) pivot = std::abs(a[i][k]) > std::abs(a[pivot][k]) ? i : pivot;
      std::swap(a[k], a[pivot]);
      for (std::size_t i = k + 1; i < n; ++i) {
        const double factor = a[i][k] / a[k][k];
        if (factor == 0) continue;
        for (std::size_t j = k; j <= n; ++j) a[i][j] -= factor * a[k][j];
      }
    }
    std::vector<double> x(n);
    for (std::size_t k = n; k-- > 0;) {
      double sum = a[k][n];
      for (std::size_t j = k + 1; j < n; ++j) sum -= a[k][j] * x[j];
      x[k] = sum / a[k][k];
    }
    b.push_back(std::move(x));
  }
  return b;
}

/// Σ_{k <= bounces} (diag(ρ) F)^k e.
inline Doubles reference_bounces(const FormFactorMatrix& f, const Columns& rho, const Columns& e, int bounces) {
  const std::size_t n = f.size();
  Doubles b;
  for (std::size_t c = 0; c < e.size(); ++c) {
    std::vector<double> term(e[c].begin(), e[c].end()), sum = term;
    for (int k = 0; k < bounces; ++k) {
      std::vector<double> next(n);
      for (std::size_t i = 0; i < n; ++i) {
        const auto row = f.row(static_cast<std::uint32_t>(i));
        for (std::size_t j = 0; j < n; ++j) next[i] += static_cast<double>(row[j]) * term[j];
        next[i] *= static_cast<double>(rho[c][i]);
        sum[i] += next[i];
      }
      term = next;
    }
    b.push_back(std::move(sum));
  }
  return b;
}

/// ‖e − (I − diag(ρ) F) b‖₂ / ‖e‖₂ of a column.
inline double reference_residual(const FormFactorMatrix& f, const std::vector<float>& rho, const std::vector<float>& e,
                                 const std::vector<float>& b) {
  double rr = 0, ee = 0;
  for (std::size_t i = 0; i < e.size(); ++i) {
    const auto row = f.row(static_cast<std::uint32_t>(i));
    double y = 0;
    for (std::size_t j = 0; j < e.size(); ++j) y += static_cast<double>(row[j]) * static_cast<double>(b[j]);
    const double r = static_cast<double>(e[i]) - static_cast<double>(b[i]) + static_cast<double>(rho[i]) * y;
    rr += r * r;
    ee += static_cast<double>(e[i]) * static_cast<double>(e[i]);
  }
  return std::sqrt(rr / ee);
}

/// max |a − b| / max |b| over a column.
template <class A, class B>
double relative_to_maximum(const std::vector<A>& a, const std::vector<B>& b) {
  double difference = 0, largest = 0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    difference = std::max(difference, std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i])));
    largest = std::max(largest, std::abs(static_cast<double>(b[i])));
  }
  return largest > 0 ? difference / largest : difference;
}

}  // namespace interflect::test
