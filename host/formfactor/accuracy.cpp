#include "interflect/formfactor/accuracy.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr double medium = 5e-3;
constexpr std::array<std::pair<std::string_view, double>, 3> names{{{"low", 2e-2}, {"medium", medium}, {"high", 1e-3}}};
constexpr double coarsest = 0.5;

}  // namespace

Accuracy accuracy_of(std::string_view text) {
  for (const auto& [name, eps] : names) {
    if (text == name) return {eps};
  }
  double eps = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), eps);
  if (error != std::errc{} || end != text.data() + text.size() || !(eps > 0 && eps <= coarsest)) {
    throw Error(
        ErrorKind::usage,
        fmt::format("accuracy '{}': low, medium, high or a number above 0 and at most {} is wanted", text, coarsest));
  }
  return {eps};
}

std::string text_of(const Accuracy& accuracy) {
  for (const auto& [name, eps] : names) {
    if (accuracy.eps == eps) return std::string(name);
  }
  return fmt::format("{}", accuracy.eps);
}

RayBudget budget_of(const Accuracy& accuracy) {
  const double eps = accuracy.eps, finer = medium / eps;  // than medium
  const auto whole = [](double x, double low, double high) {
    return static_cast<std::uint32_t>(std::lround(std::clamp(x, low, high)));
  };
  RayBudget out;
  const double all = 0.25 / (eps * eps);
  out.rays_per_factor = static_cast<float>(all);
  out.pilot_per_factor = static_cast<float>(all / 5);
  out.most_in_pilot = whole(64 * finer, 16, 4096);
  out.fewest_when_mixed = whole(4 * finer, 1, 4);
  out.most = whole(8192 * finer, 1024, 65536);
  // A cut pair costs up to 256 contour integrals and 16 times the fewest rays.
  out.split_from = static_cast<float>(std::clamp(0.01 / finer, 5e-3, 0.1));
  // The quadrature's error falls with about the fourth power of the ratio; medium's does from 1e-3 to 5e-3.
  const double nearer = std::pow(eps > medium ? medium / eps : std::max(1.0, 1e-3 / eps), 0.25);
  out.ratios.three_points *= static_cast<float>(std::clamp(nearer, 0.7, 2.0));
  out.ratios.six_points *= static_cast<float>(std::clamp(nearer, 0.7, 2.0));
  return out;
}

}  // namespace interflect
