#include "power_law.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace interflect::cli {

using nlohmann::ordered_json;

namespace {

std::string text_of(const std::optional<PowerLaw>& law) {
  if (!law) return "no fit: fewer than three sizes";
  const std::string fit = fmt::format("n^{:.3f}, within {:.1f} %", law->exponent, 100 * law->deviation);
  return law->holds() ? fit : fit + ": no power law";
}

ordered_json json_of(const std::optional<PowerLaw>& law) {
  if (!law) return nullptr;
  return {
      {"exponent", law->exponent}, {"factor", law->factor}, {"deviation", law->deviation}, {"power_law", law->holds()}};
}

std::optional<PowerLaw> fitted(const std::vector<const BenchRow*>& rows, double (*value)(const BenchRow&)) {
  std::vector<std::pair<double, double>> points;
  for (const BenchRow* row : rows) points.emplace_back(static_cast<double>(row->n), value(*row));
  return fit_power_law(points);
}

}  // namespace

double PowerLaw::at(double x) const {
  return factor * std::pow(x, exponent);
}

std::optional<PowerLaw> fit_power_law(const std::vector<std::pair<double, double>>& points) {
  if (points.size() < 3) return std::nullopt;
  const auto count = static_cast<double>(points.size());
  double mean_x = 0, mean_y = 0;
  for (const auto& [x, y] : points) {
    if (!(x > 0) || !(y > 0)) return std::nullopt;
    mean_x += std::log(x) / count;
    mean_y += std::log(y) / count;
  }
  double xx = 0, xy = 0;
  for (const auto& [x, y] : points) {
    xx += (std::log(x) - mean_x) * (std::log(x) - mean_x);
    xy += (std::log(x) - mean_x) * (std::log(y) - mean_y);
  }
  if (!(xx > 1e-12)) return std::nullopt;
  PowerLaw law;
  law.exponent = xy / xx;
  law.factor = std::exp(mean_y - law.exponent * mean_x);
  for (const auto& [x, y] : points) law.deviation = std::max(law.deviation, std::abs(y / law.at(x) - 1));
  return law;
}

std::vector<Growth> growth_of(const std::vector<BenchRow>& rows) {
  std::vector<Growth> all;
  for (const BenchRow& row : rows) {
    if (row.what != "growth" || row.status != "pass") continue;
    auto found = std::find_if(all.begin(), all.end(), [&](const Growth& one) {
      return one.device == row.device && one.scene == row.scene && one.storage == row.storage;
    });
    if (found == all.end()) found = all.insert(all.end(), Growth{row.device, row.scene, row.storage, {}, {}, {}});
    found->rows.push_back(&row);
  }
  for (Growth& one : all) {
    std::stable_sort(one.rows.begin(), one.rows.end(),
                     [](const BenchRow* a, const BenchRow* b) { return a->n < b->n; });
    one.time = fitted(one.rows, [](const BenchRow& row) { return row.seconds; });
    one.bytes = fitted(one.rows, [](const BenchRow& row) { return static_cast<double>(row.bytes); });
  }
  return all;
}

std::string growth_text(const std::vector<Growth>& all) {
  std::string out;
  for (const Growth& one : all) {
    out += fmt::format("growth of {:<10} {:<11} {:<8} {} to {} patches: time {}; bytes {}\n", one.device, one.scene,
                       one.storage, one.rows.front()->n, one.rows.back()->n, text_of(one.time), text_of(one.bytes));
  }
  return out;
}

ordered_json growth_json(const std::vector<Growth>& all) {
  auto out = ordered_json::array();
  for (const Growth& one : all) {
    auto sizes = ordered_json::array();
    for (const BenchRow* row : one.rows) sizes.push_back(row->n);
    out.push_back({{"device", one.device},
                   {"scene", one.scene},
                   {"storage", one.storage},
                   {"n", sizes},
                   {"time", json_of(one.time)},
                   {"bytes", json_of(one.bytes)}});
  }
  return out;
}

}  // namespace interflect::cli
