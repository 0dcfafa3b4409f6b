#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench_row.h"

namespace interflect::cli {

/// y = factor x^exponent, fitted to points.
struct PowerLaw {
  double exponent = 0, factor = 0;
  double deviation = 0;  ///< the largest |y / (factor x^exponent) − 1| of a point
  [[nodiscard]] double at(double x) const;
  /// Points that lie further off than this share are not on a power law, whatever was fitted to them.
  static constexpr double most_deviation = 0.25;
  [[nodiscard]] bool holds() const { return deviation <= most_deviation; }
};

/// Least squares on log y over log x. None for fewer than three points, for values that are not positive, or when all x
/// are the same: two points are always on a line.
[[nodiscard]] std::optional<PowerLaw> fit_power_law(const std::vector<std::pair<double, double>>& points);

/// The growth of one storage on one device: its rows by size, and what was fitted to them.
struct Growth {
  std::string device, scene, storage;
  std::vector<const BenchRow*> rows;
  std::optional<PowerLaw> time, bytes;
};
/// Of all verified "growth" rows, by device, scene and storage in the order of the rows. Points into them.
[[nodiscard]] std::vector<Growth> growth_of(const std::vector<BenchRow>& rows);
[[nodiscard]] std::string growth_text(const std::vector<Growth>& all);
[[nodiscard]] nlohmann::ordered_json growth_json(const std::vector<Growth>& all);

}  // namespace interflect::cli
