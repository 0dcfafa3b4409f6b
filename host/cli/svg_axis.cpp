#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "svg.h"

namespace interflect::cli {

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

std::vector<double> Axis::ticks() const {
  std::vector<double> found;
  if (!logarithmic_) {
    const double rough = (high_ - low_) / 6, power = std::pow(10, std::floor(std::log10(rough)));
    const double step = rough > 5 * power ? 10 * power : rough > 2 * power ? 5 * power : 2 * power;
    for (double k = std::ceil(low_ / step); k * step <= high_ * (1 + 1e-9); ++k) found.push_back(k * step);
    return found;
  }
  const double decades = std::log10(high_ / low_);
  const std::vector<double> steps = decades > 4     ? std::vector<double>{1}
                                    : decades > 1.2 ? std::vector<double>{1, 2, 5}
                                                    : std::vector<double>{1, 1.5, 2, 3, 4, 5, 6, 8};
  for (double power = std::floor(std::log10(low_)); power <= std::log10(high_); ++power) {
    for (const double step : steps) {
      const double value = step * std::pow(10, power);
      if (value >= low_ && value <= high_) found.push_back(value);
    }
  }
  // Labels need about 38 pixels each.
  const auto most = static_cast<std::size_t>(std::max(2.0, std::abs(to_ - from_) / 38));
  const std::size_t every = (found.size() + most - 1) / most;
  std::vector<double> thinned;
  for (std::size_t k = 0; every > 0 && k < found.size(); k += every) thinned.push_back(found[k]);
  return thinned;
}

void draw_x_axis(Svg& svg, const Axis& x, double top, double bottom, std::string_view name, Label label) {
  for (const double tick : x.ticks()) {
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
  for (const double tick : y.ticks()) {
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
