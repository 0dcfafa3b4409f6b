#include "interflect/solver/rounding.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "interflect/solver/batches.h"
#include "interflect/solver/solver.h"

namespace interflect {

namespace {

double largest(std::span<const std::vector<float>> columns) {
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
  const auto exact = [&](const Columns& x, auto& y) { exact_product(form_factors, x, y); };
  return rounding_error(scheduler, method, exact, area, reflectance, emittance, radiosity);
}

double rounding_error(Scheduler& scheduler, Method method,
                      const std::function<void(const Columns& x, std::vector<std::vector<double>>& y)>& exact_dense,
                      std::span<const double> area, const Columns& reflectance, const Columns& emittance,
                      const Columns& radiosity) {
  std::vector<std::vector<double>> received;
  exact_dense(radiosity, received);
  Columns residual = radiosity;
  for (std::size_t c = 0; c < residual.size(); ++c) {
    const std::vector<float>& rho = reflectance[c % reflectance.size()];
    for (std::size_t i = 0; i < residual[c].size(); ++i) {
      const double bounced = static_cast<double>(rho[i]) * received[c][i];
      residual[c][i] =
          static_cast<float>(static_cast<double>(emittance[c][i]) - static_cast<double>(radiosity[c][i]) + bounced);
    }
  }
  const StopTest stop{.tolerance = 0.01};
  BatchedSolve batches(method, stop, area, reflectance, residual);
  batches.run(scheduler);
  if (!batches.report().converged) return std::numeric_limits<double>::quiet_NaN();
  double worst = 0;
  for (std::size_t first = 0; first < radiosity.size(); first += reflectance.size()) {
    const double size = largest(std::span(radiosity).subspan(first, reflectance.size()));
    const double error = largest(std::span(batches.radiosity()).subspan(first, reflectance.size()));
    if (size > 0) worst = std::max(worst, error / size);
  }
  return worst;
}

}  // namespace interflect
