#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "svg.h"

namespace interflect::cli {

namespace {

constexpr double label_width = 46, label_height = 24;  // pixels, with what is to be free around them

}  // namespace

Axis::Axis(double low, double high, double from, double to, bool logarithmic)
    : low_(low), high_(high), from_(from), to_(to), logarithmic_(logarithmic) {}

Axis Axis::around(const std::vector<double>& values, double from, double to) {
  double low = INFINITY, high = 0;
  for (const double value : values) {
    if (!(value > 0) || !std::isfinite(value)) continue;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  if (!(high > 0)) low = high = 1;
  const double margin = std::pow(high / low, 0.06) * 1.15;
  return {low / margin, high * margin, from, to, true};
}

double Axis::at(double value) const {
  const double share = logarithmic_ ? std::log(value / low_) / std::log(high_ / low_) : (value - low_) / (high_ - low_);
  return from_ + std::clamp(share, 0.0, 1.0) * (to_ - from_);
}

namespace {

/// Multiples of the steps in every decade within [low, high].
std::vector<double> decade_ticks(double low, double high, const std::vector<double>& steps) {
  std::vector<double> found;
  for (double power = std::floor(std::log10(low)); power <= std::log10(high); ++power) {
    for (const double step : steps) {
      const double value = step * std::pow(10, power);
      if (value >= low && value <= high) found.push_back(value);
    }
  }
  return found;
}

}  // namespace

std::vector<double> Axis::ticks(double room) const {
  std::vector<double> found;
  if (!logarithmic_) {
    const double rough = (high_ - low_) / 6, power = std::pow(10, std::floor(std::log10(rough)));
    const double step = rough > 5 * power ? 10 * power : rough > 2 * power ? 5 * power : 2 * power;
    for (double k = std::ceil(low_ / step); k * step <= high_ * (1 + 1e-9); ++k) found.push_back(k * step);
    return found;
  }
  const std::vector<std::vector<double>> choices{{1, 1.5, 2, 3, 4, 5, 6, 8}, {1, 2, 3, 5}, {1, 2, 5}, {1, 3}, {1}};
  for (const std::vector<double>& steps : choices) {
    found = decade_ticks(low_, high_, steps);
    bool fits = true;
    for (std::size_t k = 1; k < found.size(); ++k) fits = fits && std::abs(at(found[k]) - at(found[k - 1])) >= room;
    if (fits) return found;
  }
  std::vector<double> thinned;  // every so many decades
  for (const double value : found) {
    if (thinned.empty() || std::abs(at(value) - at(thinned.back())) >= room) thinned.push_back(value);
  }
  return thinned;
}

void draw_x_axis(Svg& svg, const Axis& x, double top, double bottom, std::string_view name, Label label) {
  for (const double tick : x.ticks(label_width)) {
    svg.line(x.at(tick), top, x.at(tick), bottom, "grid");
    svg.text(x.at(tick), bottom + 15, label(tick), "dim small", Svg::Anchor::middle);
  }
  svg.line(x.from(), bottom, x.to(), bottom, "axis");
  svg.text((x.from() + x.to()) / 2, bottom + 32, name, "dim", Svg::Anchor::middle);
}

void draw_axes(Svg& svg, const Axis& x, const Axis& y, std::string_view x_name, std::string_view y_name, Label x_label,
               Label y_label) {
  draw_x_axis(svg, x, y.to(), y.from(), x_name, x_label);
  double widest = 0;
  for (const double tick : y.ticks(label_height)) {
    const std::string text = y_label(tick);
    widest = std::max(widest, text_width(text, 11));
    svg.line(x.from(), y.at(tick), x.to(), y.at(tick), "grid");
    svg.text(x.from() - 6, y.at(tick) + 4, text, "dim small", Svg::Anchor::end);
  }
  svg.line(x.from(), y.from(), x.from(), y.to(), "axis");
  svg.text_upwards(x.from() - widest - 14, (y.from() + y.to()) / 2, y_name, "dim");
}

std::string plain(double value) {
  return fmt::format("{:.4g}", value);
}

namespace {

struct Unit {
  double size;
  const char* name;
};

/// In the largest unit that leaves 1 or more; in the last one else.
template <std::size_t n>
std::string with_unit(double value, const std::array<Unit, n>& units) {
  const auto fits = [&](const Unit& unit) { return value >= unit.size * 0.9995; };
  const auto found = std::find_if(units.begin(), units.end(), fits);
  const Unit& unit = found == units.end() ? units.back() : *found;
  return fmt::format("{:.3g}{}", value / unit.size, unit.name);
}

}  // namespace

std::string seconds(double value) {
  constexpr std::array units{Unit{1, " s"}, Unit{1e-3, " ms"}, Unit{1e-6, " µs"}, Unit{1e-9, " ns"}};
  return with_unit(value, units);
}

std::string bytes(double value) {
  constexpr std::array units{Unit{1e12, " TB"}, Unit{1e9, " GB"}, Unit{1e6, " MB"}, Unit{1e3, " kB"}, Unit{1, " B"}};
  return with_unit(value, units);
}

std::string count(double value) {
  constexpr std::array units{Unit{1e6, "M"}, Unit{1e3, "k"}, Unit{1, ""}};
  return with_unit(value, units);
}

}  // namespace interflect::cli
