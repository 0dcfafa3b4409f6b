#include "interflect/formfactor/estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numeric>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

namespace {

constexpr std::size_t block = PatchTable::block;

/// w_j for W vectors w.
template <std::size_t W>
using Weights = std::function<std::array<double, W>(std::size_t j)>;

/// Σ_j min(a, A_j) v_j over a block of patches, for any a and K vectors v at once: by ascending area, the sums of A_j
/// v_j up to each place and of v_j from there on. v of the first vector is 1, of the others A_j w_j.
template <std::size_t K>
class SortedBlock {
 public:
  using Values = std::array<double, K>;

  SortedBlock(std::size_t first, std::size_t end, const std::vector<double>& areas, const Weights<K - 1>& weight)
      : patch(end - first), below_(end - first + 1), above_(end - first + 1) {
    std::iota(patch.begin(), patch.end(), first);
    std::stable_sort(patch.begin(), patch.end(), [&](std::size_t i, std::size_t j) { return areas[i] < areas[j]; });
    for (const std::size_t j : patch) area.push_back(areas[j]);
    std::vector<Values> v(patch.size());
    for (std::size_t m = 0; m < patch.size(); ++m) {
      v[m][0] = 1;
      for (std::size_t k = 1; k < K; ++k) v[m][k] = area[m] * weight(patch[m])[k - 1];
      for (std::size_t k = 0; k < K; ++k) below_[m + 1][k] = below_[m][k] + area[m] * v[m][k];
    }
    for (std::size_t m = patch.size(); m-- > 0;) {
      for (std::size_t k = 0; k < K; ++k) above_[m][k] = above_[m + 1][k] + v[m][k];
    }
  }
  /// The areas before `low` are at most a, those from `high` on at least a; what is in between is left out.
  [[nodiscard]] Values sums(double a, std::size_t low, std::size_t high) const {
    Values out;
    for (std::size_t k = 0; k < K; ++k) out[k] = below_[low][k] + a * above_[high][k];
    return out;
  }

  std::vector<std::size_t> patch;
  std::vector<double> area = {};  ///< ascending

 private:
  std::vector<Values> below_, above_;
};

/// Where a tile's variance lies among its pairs is not kept. σ²(S_ij) / (A_i A_j) is taken as proportional to
/// min(A_i, A_j): rays are given by the larger of the two form factors, S / min(A_i, A_j). Adds to out[i], for the
/// patches i of `rows`, A_i Σ_j σ²(F_ij) w_j over the tile's pairs with the patches j of `columns`.
template <std::size_t K>
void add_tile(const SortedBlock<K>& rows, const SortedBlock<K>& columns, double variance,
              std::vector<std::array<double, K - 1>>& out) {
  std::array<typename SortedBlock<K>::Values, block> sums;
  double all = 0;
  for (std::size_t r = 0, m = 0; r < rows.patch.size(); ++r) {
    while (m < columns.area.size() && columns.area[m] <= rows.area[r]) ++m;
    sums[r] = &rows == &columns ? columns.sums(rows.area[r], r, r + 1) : columns.sums(rows.area[r], m, m);
    all += sums[r][0];
  }
  if (&rows == &columns) all /= 2;  // each pair was there twice
  if (!(all > 0)) return;
  for (std::size_t r = 0; r < rows.patch.size(); ++r) {
    for (std::size_t k = 1; k < K; ++k) out[rows.patch[r]][k - 1] += variance / all * sums[r][k];
  }
}

/// Σ_j σ²(F_ij) w_j for every i, and W vectors w at once. Each row is summed by one thread, in order.
template <std::size_t W>
std::vector<std::array<double, W>> weighted_variance(std::span<const float> tile_variance,
                                                     const std::vector<double>& area, const Weights<W>& weight) {
  const std::size_t n = area.size(), blocks = (n + block - 1) / block;
  if (tile_variance.size() != tiles_in_rows(0, blocks, blocks)) {
    throw Error(ErrorKind::internal, fmt::format("{} tile variances for {} patches", tile_variance.size(), n));
  }
  std::vector<SortedBlock<W + 1>> sorted;
  for (std::size_t b = 0; b < blocks; ++b) sorted.emplace_back(b * block, std::min((b + 1) * block, n), area, weight);
  std::vector<std::array<double, W>> out(n);
#pragma omp parallel for schedule(dynamic)
  for (std::size_t r = 0; r < blocks; ++r) {
    for (std::size_t c = 0; c < blocks; ++c) {
      const std::size_t low = std::min(r, c), high = std::max(r, c);
      const float variance = tile_variance[tiles_in_rows(0, low, blocks) + high - low];
      if (variance > 0) add_tile(sorted[r], sorted[c], static_cast<double>(variance), out);
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (double& square : out[i]) square = area[i] > 0 ? square / area[i] : 0;
  }
  return out;
}

EstimatedError summary(const std::vector<double>& errors) {
  EstimatedError out;
  for (const double error : errors) {
    out.rms += error * error;
    out.max = std::max(out.max, error);
  }
  out.rms = errors.empty() ? 0 : std::sqrt(out.rms / static_cast<double>(errors.size()));
  return out;
}

}  // namespace

std::vector<double> row_errors(std::span<const float> tile_variance, const std::vector<double>& area) {
  std::vector<double> out;
  for (const auto& square : weighted_variance<1>(tile_variance, area, [](std::size_t) { return std::array{1.0}; })) {
    out.push_back(std::sqrt(square[0]));
  }
  return out;
}

EstimatedError row_sum_error(std::span<const float> tile_variance, const std::vector<double>& area) {
  return summary(row_errors(tile_variance, area));
}

EstimatedError radiosity_error(std::span<const float> tile_variance, const std::vector<double>& area,
                               const std::vector<Rgb>& reflectance, const std::vector<Rgb>& radiosity) {
  const auto squares = weighted_variance<3>(tile_variance, area, [&](std::size_t j) {
    const Rgb& b = radiosity[j];
    return std::array{b[0] * b[0], b[1] * b[1], b[2] * b[2]};
  });
  EstimatedError worst;
  for (std::size_t c = 0; c < 3; ++c) {
    double largest = 0;
    for (const Rgb& b : radiosity) largest = std::max(largest, std::abs(b[c]));
    if (!(largest > 0)) continue;
    std::vector<double> errors;
    for (std::size_t i = 0; i < squares.size(); ++i) {
      errors.push_back(reflectance[i][c] / largest * std::sqrt(squares[i][c]));
    }
    const EstimatedError here = summary(errors);
    worst = {std::max(worst.rms, here.rms), std::max(worst.max, here.max)};
  }
  return worst;
}

}  // namespace interflect
