#include "interflect/solver/rounding.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "interflect/solver/solver.h"

namespace interflect {

namespace {

double largest(const Columns& columns) {
  double size = 0;
  for (const std::vector<float>& column : columns) {
    for (const float value : column) size = std::max(size, std::abs(static_cast<double>(value)));
  }
  return size;
}

}  // namespace

double rounding_error(Scheduler& scheduler, Method method, const FormFactorMatrix& form_factors,
                      std::span<const double> area, const Columns& reflectance, const Columns& emittance,
                      const Columns& radiosity) {
  std::vector<std::vector<double>> received;
  exact_product(form_factors, radiosity, received);
  Columns residual = radiosity;
  for (std::size_t c = 0; c < residual.size(); ++c) {
    for (std::size_t i = 0; i < residual[c].size(); ++i) {
      const double bounced = static_cast<double>(reflectance[c][i]) * received[c][i];
      residual[c][i] =
          static_cast<float>(static_cast<double>(emittance[c][i]) - static_cast<double>(radiosity[c][i]) + bounced);
    }
  }
  Columns difference;
  const SolveReport report = solve(scheduler, method, {.tolerance = 0.01}, area, reflectance, residual, difference);
  if (!report.converged) return std::numeric_limits<double>::quiet_NaN();
  const double size = largest(radiosity);
  return size > 0 ? largest(difference) / size : 0.0;
}

}  // namespace interflect
