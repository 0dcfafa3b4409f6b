#include "interflect/formfactor/estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

namespace {

constexpr std::size_t block = PatchTable::block;

/// Σ_j σ²(F_ij) w_j for every i: by tiles, (1 / A_i) Σ_c share(r, c) Σ_{j∈c} A_j w_j; in a tile on the diagonal j ≠ i.
std::vector<double> weighted_variance(std::span<const float> tile_variance, const std::vector<double>& area,
                                      const std::function<double(std::size_t)>& weight) {
  const std::size_t n = area.size(), blocks = (n + block - 1) / block;
  if (tile_variance.size() != tiles_in_rows(0, blocks, blocks)) {
    throw Error(ErrorKind::internal, fmt::format("{} tile variances for {} patches", tile_variance.size(), n));
  }
  std::vector<double> of_block(blocks), sum(blocks), diagonal(blocks);
  for (std::size_t j = 0; j < n; ++j) of_block[j / block] += area[j] * weight(j);
  const auto patches = [&](std::size_t b) { return static_cast<double>(std::min(block, n - b * block)); };
  std::size_t tile = 0;
  for (std::size_t r = 0; r < blocks; ++r) {
    for (std::size_t c = r; c < blocks; ++c, ++tile) {
      const auto variance = static_cast<double>(tile_variance[tile]);
      if (!(variance > 0)) continue;
      if (r == c) {
        diagonal[r] = variance / (patches(r) * (patches(r) - 1) / 2);
        continue;
      }
      const double share = variance / (patches(r) * patches(c));
      sum[r] += share * of_block[c];
      sum[c] += share * of_block[r];
    }
  }
  std::vector<double> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t b = i / block;
    const double within = diagonal[b] * (of_block[b] - area[i] * weight(i));
    out[i] = area[i] > 0 ? (sum[b] + within) / area[i] : 0;
  }
  return out;
}

EstimatedError summary(const std::vector<double>& squares) {
  EstimatedError out;
  for (const double square : squares) {
    out.rms += square;
    out.max = std::max(out.max, std::sqrt(square));
  }
  out.rms = squares.empty() ? 0 : std::sqrt(out.rms / static_cast<double>(squares.size()));
  return out;
}

}  // namespace

EstimatedError row_sum_error(std::span<const float> tile_variance, const std::vector<double>& area) {
  return summary(weighted_variance(tile_variance, area, [](std::size_t) { return 1.0; }));
}

EstimatedError radiosity_error(std::span<const float> tile_variance, const std::vector<double>& area,
                               const std::vector<Rgb>& reflectance, const std::vector<Rgb>& radiosity) {
  EstimatedError worst;
  for (std::size_t c = 0; c < 3; ++c) {
    double largest = 0;
    for (const Rgb& b : radiosity) largest = std::max(largest, std::abs(b[c]));
    if (!(largest > 0)) continue;
    std::vector<double> squares =
        weighted_variance(tile_variance, area, [&](std::size_t j) { return radiosity[j][c] * radiosity[j][c]; });
    for (std::size_t i = 0; i < squares.size(); ++i) {
      const double factor = reflectance[i][c] / largest;
      squares[i] *= factor * factor;
    }
    const EstimatedError here = summary(squares);
    worst = {std::max(worst.rms, here.rms), std::max(worst.max, here.max)};
  }
  return worst;
}

}  // namespace interflect
