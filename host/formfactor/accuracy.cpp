#include "interflect/formfactor/accuracy.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/tile_maker.h"

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

namespace {

/// What turns a tile's variance into the sum over its rows and columns of the rows' variances: the mean of A_j / A_i +
/// A_i / A_j over its pairs, each with the share of the variance that falls to it. That goes like min(A_i, A_j) where
/// the rays go with F. Every fourth patch of a block stands for it.
double ratio_of_areas(std::span<const double> rows, std::span<const double> columns) {
  constexpr std::size_t step = 4;
  double sum = 0, weights = 0;
  for (std::size_t a = 0; a < rows.size(); a += step) {
    for (std::size_t b = 0; b < columns.size(); b += step) {
      const double low = std::min(rows[a], columns[b]), high = std::max(rows[a], columns[b]);
      if (!(low > 0)) continue;
      sum += low * (high / low + low / high);
      weights += low;
    }
  }
  return weights > 0 ? sum / weights : 0;
}

}  // namespace

double row_error(std::span<const double> area, std::size_t patches, std::span<const float> variance) {
  const std::uint64_t blocks = (patches + PatchTable::block - 1) / PatchTable::block;
  if (variance.size() != tiles_in_rows(0, blocks, blocks)) {
    throw Error(ErrorKind::internal, fmt::format("{} variances for {} patches", variance.size(), patches));
  }
  const auto block = [&](std::size_t b) {
    const std::size_t first = b * PatchTable::block;
    return area.subspan(first, std::min<std::size_t>(PatchTable::block, patches - first));
  };
  double sum = 0;
  std::size_t tile = 0;
  for (std::size_t r = 0; r < blocks; ++r) {
    for (std::size_t c = r; c < blocks; ++c, ++tile) {
      if (variance[tile] > 0) sum += static_cast<double>(variance[tile]) * ratio_of_areas(block(r), block(c));
    }
  }
  return patches > 0 ? std::sqrt(sum / static_cast<double>(patches)) : 0;
}

}  // namespace interflect
