#include "study_loops.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"

namespace interflect::cli {

namespace {

using Sums = std::array<double, 3>;

/// Vectors as arrays of structures.
class Aos {
 public:
  struct Rgb {
    float r = 0, g = 0, b = 0;
  };
  explicit Aos(const Columns& columns) : values_(columns[0].size()) {
    for (std::size_t i = 0; i < values_.size(); ++i) values_[i] = {columns[0][i], columns[1][i], columns[2][i]};
  }
  /// to_i = e_i + ρ_i Σ_j F_ij b_j
  static void bounce(std::span<const float> row, std::size_t i, const Aos& e, const Aos& rho, const Aos& b, Aos& to) {
    Rgb sum;
    for (std::size_t j = 0; j < row.size(); ++j) {
      sum.r += row[j] * b.values_[j].r;
      sum.g += row[j] * b.values_[j].g;
      sum.b += row[j] * b.values_[j].b;
    }
    to.values_[i] = {e.values_[i].r + rho.values_[i].r * sum.r, e.values_[i].g + rho.values_[i].g * sum.g,
                     e.values_[i].b + rho.values_[i].b * sum.b};
  }
  [[nodiscard]] std::array<double, 3> at(std::size_t i) const {
    return {static_cast<double>(values_[i].r), static_cast<double>(values_[i].g), static_cast<double>(values_[i].b)};
  }
  [[nodiscard]] std::size_t size() const { return values_.size(); }

 private:
  std::vector<Rgb> values_;
};

/// Vectors as structures of arrays.
class Soa {
 public:
  explicit Soa(const Columns& columns) : r_(columns[0]), g_(columns[1]), b_(columns[2]) {}
  static void bounce(std::span<const float> row, std::size_t i, const Soa& e, const Soa& rho, const Soa& b, Soa& to) {
    float r = 0, g = 0, blue = 0;
    for (std::size_t j = 0; j < row.size(); ++j) {
      r += row[j] * b.r_[j];
      g += row[j] * b.g_[j];
      blue += row[j] * b.b_[j];
    }
    to.r_[i] = e.r_[i] + rho.r_[i] * r;
    to.g_[i] = e.g_[i] + rho.g_[i] * g;
    to.b_[i] = e.b_[i] + rho.b_[i] * blue;
  }
  [[nodiscard]] std::array<double, 3> at(std::size_t i) const {
    return {static_cast<double>(r_[i]), static_cast<double>(g_[i]), static_cast<double>(b_[i])};
  }
  [[nodiscard]] std::size_t size() const { return r_.size(); }

 private:
  std::vector<float> r_, g_, b_;
};

template <class Vector>
void serial_bounces(const FormFactorMatrix& f, const Vector& e, const Vector& rho, const Vector& b, Vector& to) {
  for (std::uint32_t i = 0; i < f.size(); ++i) Vector::bounce(f.row(i), i, e, rho, b, to);
}

template <class Vector>
void parallel_bounces(const FormFactorMatrix& f, const Vector& e, const Vector& rho, const Vector& b, Vector& to) {
#pragma omp parallel for
  for (std::uint32_t i = 0; i < f.size(); ++i) Vector::bounce(f.row(i), i, e, rho, b, to);
}

template <class Vector>
Sums squares(const Vector& v) {
  Sums sums{};
  for (std::size_t i = 0; i < v.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) sums[c] += v.at(i)[c] * v.at(i)[c];
  }
  return sums;
}

/// ‖a − b‖² of every channel.
template <class Vector>
Sums distances(const Vector& a, const Vector& b) {
  Sums sums{};
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const double difference = a.at(i)[c] - b.at(i)[c];
      sums[c] += difference * difference;
    }
  }
  return sums;
}

template <class Vector>
LoopReport jacobi(const FormFactorMatrix& f, const Columns& reflectance, const Columns& emittance, bool parallel,
                  const StopTest& stop, Columns& radiosity) {
  const Vector rho(reflectance), e(emittance);
  Vector b = e, next = e;
  LoopReport report;
  const Timer timer;
  const Sums norms = squares(e);
  while (!report.converged && report.iterations < stop.max_iterations) {
    parallel ? parallel_bounces(f, e, rho, b, next) : serial_bounces(f, e, rho, b, next);
    ++report.iterations;
    const Sums residuals = distances(next, b);  // e + ρ∘(F b) − b
    report.converged = true;
    for (std::size_t c = 0; c < 3; ++c) {
      const double norm = norms[c] > 0 ? norms[c] : 1;
      if (!(residuals[c] <= stop.tolerance * stop.tolerance * norm)) report.converged = false;  // also for a NaN
    }
    std::swap(b, next);
  }
  report.seconds = timer.seconds();
  radiosity.assign(3, std::vector<float>(b.size()));
  for (std::size_t i = 0; i < b.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) radiosity[c][i] = static_cast<float>(b.at(i)[c]);
  }
  return report;
}

}  // namespace

LoopReport plain_jacobi(const FormFactorMatrix& f, const Columns& reflectance, const Columns& emittance,
                        VectorLayout layout, bool parallel, const StopTest& stop, Columns& radiosity) {
  for (const Columns* columns : {&reflectance, &emittance}) {
    const bool fits = columns->size() == 3 && std::all_of(columns->begin(), columns->end(), [&](const auto& column) {
                        return column.size() == f.size();
                      });
    if (!fits) throw Error(ErrorKind::internal, "the plain loop takes three columns of N values");
  }
  return layout == VectorLayout::aos ? jacobi<Aos>(f, reflectance, emittance, parallel, stop, radiosity)
                                     : jacobi<Soa>(f, reflectance, emittance, parallel, stop, radiosity);
}

}  // namespace interflect::cli
