#include "interflect/solver/problem.h"

#include <fmt/format.h>

#include <cmath>
#include <numeric>

#include "interflect/base/error.h"

namespace interflect {

namespace {

void check_shape(const Columns& columns, const Scheduler& scheduler, std::string_view what) {
  bool right = columns.size() == scheduler.columns();
  for (const auto& column : columns) right = right && column.size() == scheduler.size();
  if (right) return;
  throw Error(ErrorKind::usage, fmt::format("solve: {}: {} columns of {} patches are needed", what, scheduler.columns(),
                                            scheduler.size()));
}

/// Throws for the first value that `good` refuses.
template <class Good>
void check_values(const Columns& columns, std::string_view what, std::string_view wanted, Good good) {
  for (std::size_t c = 0; c < columns.size(); ++c) {
    for (std::size_t i = 0; i < columns[c].size(); ++i) {
      if (good(columns[c][i])) continue;
      throw Error(ErrorKind::input,
                  fmt::format("{} of patch {}, column {}: {} is not {}", what, i, c, columns[c][i], wanted));
    }
  }
}

double norm(std::span<const double> values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum);
}

}  // namespace

Problem::Problem(Scheduler& scheduler, std::span<const double> area, const Columns& reflectance,
                 const Columns& emittance)
    : scheduler_(scheduler), area_(area), reflectance_(reflectance), emittance_(emittance) {
  check_shape(reflectance, scheduler, "reflectance");
  check_shape(emittance, scheduler, "emittance");
  if (area.size() != scheduler.size()) {
    throw Error(ErrorKind::usage, fmt::format("solve: {} areas for {} patches", area.size(), scheduler.size()));
  }
  check_values(reflectance, "reflectance", "in [0, 1]", [](float v) { return v >= 0.0F && v <= 1.0F; });
  check_values(emittance, "emittance", "finite", [](float v) { return std::isfinite(v); });
  for (std::size_t i = 0; i < area.size(); ++i) {
    if (std::isfinite(area[i]) && area[i] > 0) continue;
    throw Error(ErrorKind::input, fmt::format("area of patch {}: {} is not positive and finite", i, area[i]));
  }
  for (const auto& column : emittance) norms_.push_back(norm(std::vector<double>(column.begin(), column.end())));
}

Columns Problem::weight() const {
  constexpr double negligible = 1e-12;
  const double mean = std::accumulate(area_.begin(), area_.end(), 0.0) / static_cast<double>(area_.size());
  Columns weight = reflectance_;
  for (auto& column : weight) {
    for (std::size_t i = 0; i < column.size(); ++i) {
      const auto rho = static_cast<double>(column[i]);
      column[i] = rho > negligible ? static_cast<float>(area_[i] / mean / rho) : 0.0F;
    }
  }
  return weight;
}

void Problem::residual(const Columns& b, std::vector<std::vector<double>>& r) const {
  scheduler_.exact_product(b, r);
  for (std::size_t c = 0; c < r.size(); ++c) {
    for (std::size_t i = 0; i < r[c].size(); ++i) {
      r[c][i] = static_cast<double>(emittance_[c][i]) - static_cast<double>(b[c][i]) +
                static_cast<double>(reflectance_[c][i]) * r[c][i];
    }
  }
}

double Problem::relative(const std::vector<double>& r, std::size_t column) const {
  return norms_[column] > 0 ? norm(r) / norms_[column] : norm(r);
}

}  // namespace interflect
