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

/// Where a tile's variance lies among its pairs is not kept. σ²(S_ij) / (A_i A_j) is taken as proportional to
/// min(A_i, A_j): rays are given by the larger of the two form factors, S / min(A_i, A_j).
class Spread {
 public:
  Spread(const std::vector<double>& area, const std::function<double(std::size_t)>& weight) : area_(area) {
    for (std::size_t j = 0; j < area.size(); ++j) weighted_.push_back(area[j] * weight(j));
  }
  /// Adds to out[i], for the patches of both blocks, A_i Σ_j σ²(F_ij) w_j over the pairs of the tile.
  void add(std::size_t r, std::size_t c, double variance, std::vector<double>& out) const {
    const std::size_t row_end = std::min((r + 1) * block, area_.size()), end = std::min((c + 1) * block, area_.size());
    const auto each = [&](const auto& visit) {
      for (std::size_t i = r * block; i < row_end; ++i) {
        for (std::size_t j = r == c ? i + 1 : c * block; j < end; ++j) visit(i, j, std::min(area_[i], area_[j]));
      }
    };
    double sum = 0;
    each([&](std::size_t, std::size_t, double share) { sum += share; });
    if (!(sum > 0)) return;
    each([&](std::size_t i, std::size_t j, double share) {
      out[i] += variance / sum * share * weighted_[j];
      out[j] += variance / sum * share * weighted_[i];
    });
  }

 private:
  const std::vector<double>& area_;
  std::vector<double> weighted_;  ///< A_j w_j
};

/// Σ_j σ²(F_ij) w_j for every i.
std::vector<double> weighted_variance(std::span<const float> tile_variance, const std::vector<double>& area,
                                      const std::function<double(std::size_t)>& weight) {
  const std::size_t n = area.size(), blocks = (n + block - 1) / block;
  if (tile_variance.size() != tiles_in_rows(0, blocks, blocks)) {
    throw Error(ErrorKind::internal, fmt::format("{} tile variances for {} patches", tile_variance.size(), n));
  }
  const Spread spread(area, weight);
  std::vector<double> out(n);
  std::size_t tile = 0;
  for (std::size_t r = 0; r < blocks; ++r) {
    for (std::size_t c = r; c < blocks; ++c, ++tile) {
      if (tile_variance[tile] > 0) spread.add(r, c, static_cast<double>(tile_variance[tile]), out);
    }
  }
  for (std::size_t i = 0; i < n; ++i) out[i] = area[i] > 0 ? out[i] / area[i] : 0;
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
