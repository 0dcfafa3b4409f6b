#include "interflect/output/tone.h"

#include <algorithm>
#include <cmath>

namespace interflect {

double tone_curve(double x, ToneMap tone) {
  if (!(x > 0)) return 0;
  if (tone == ToneMap::linear) return std::min(x, 1.0);
  if (x > 1e6) return 1;  // also infinity, for which the quotient is not a number
  return std::min(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0);
}

double brightness(const Rgb& colour) {
  double largest = 0;
  for (const double c : colour) {
    if (std::isfinite(c)) largest = std::max(largest, c);
  }
  return largest;
}

bool emits(const Rgb& emittance) {
  return brightness(emittance) > 0;
}

Rgb tone_map(Rgb exposed, ToneMap tone) {
  const double largest = brightness(exposed);
  const double factor = largest > 0 ? tone_curve(largest, tone) / largest : 0;
  for (double& c : exposed) c = c > 0 && std::isfinite(c) ? c * factor : 0;
  return exposed;
}

double srgb_encode(double linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 1;
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

std::uint8_t srgb_byte(double linear) {
  return static_cast<std::uint8_t>(std::lround(255 * srgb_encode(linear)));
}

double automatic_exposure(std::vector<Brightness> values, ToneMap tone) {
  constexpr double percentile = 0.97, darkest_mean = 0.06, largest_raise = 4;
  const double bright = tone == ToneMap::linear ? 0.8 : 1.0;  // tone_curve(bright) = 0.8 in both
  std::erase_if(values, [](const Brightness& b) {
    return !(b.value > 0 && std::isfinite(b.value) && b.weight > 0 && std::isfinite(b.weight));
  });
  if (values.empty()) return 1;
  std::sort(values.begin(), values.end(), [](const auto& a, const auto& b) { return a.value < b.value; });
  double total = 0, logarithms = 0;
  for (const auto& b : values) {
    total += b.weight;
    logarithms += b.weight * std::log(b.value);
  }
  double below = 0;
  const auto at = std::find_if(values.begin(), values.end() - 1,
                               [&](const Brightness& b) { return (below += b.weight) >= percentile * total; });
  const double exposure = bright / at->value;
  const double mean = exposure * std::exp(logarithms / total);
  return exposure * std::clamp(darkest_mean / mean, 1.0, largest_raise);
}

double surface_exposure(const PatchMesh& mesh, const std::vector<Rgb>& radiosity) {
  std::vector<Brightness> values;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (!emits(mesh.emittance[i])) values.push_back({brightness(radiosity[i]), mesh.area[i]});
  }
  return automatic_exposure(std::move(values), ToneMap::linear);
}

double color_scale(const PatchMesh& mesh, const std::vector<Rgb>& radiosity) {
  constexpr double very_dark = 16;
  double largest = 0;
  for (const Rgb& b : radiosity) largest = std::max(largest, brightness(b));
  const double exposure = surface_exposure(mesh, radiosity);
  return largest <= 1 && exposure <= very_dark ? 1 : exposure;
}

}  // namespace interflect
