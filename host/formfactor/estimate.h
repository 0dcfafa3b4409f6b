#pragma once

#include <span>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect {

/// What the sampling of visibility leaves, by the tiles' variances (TileFacts::variance of all tile rows): standard
/// deviations, each pair taken to err by itself, a tile's variance taken as spread over its pairs by min(A_i, A_j). The
/// closure is not looked at: it takes part of the error of a row's sum away.
struct EstimatedError {
  double rms = 0;  ///< over the patches
  double max = 0;
};

/// σ_i of each row sum of F: σ_i² = Σ_j σ²(F_ij), with σ²(F_ij) = (the pair's share of the tile's variance) A_j / A_i.
/// Throws an internal Error when the number of tiles is not that of the areas' tiles, as the functions below do. All of
/// them give the same bits whatever the number of threads.
[[nodiscard]] std::vector<double> row_errors(std::span<const float> tile_variance, const std::vector<double>& area);

/// Over all rows.
[[nodiscard]] EstimatedError row_sum_error(std::span<const float> tile_variance, const std::vector<double>& area);

/// Of the radiosities, as a share of the largest: ρ_i δ_i / max B in the channel where it is largest, with
/// δ_i² = Σ_j σ²(F_ij) B_j²: what the last bounce makes of the error of F.
[[nodiscard]] EstimatedError radiosity_error(std::span<const float> tile_variance, const std::vector<double>& area,
                                             const std::vector<Rgb>& reflectance, const std::vector<Rgb>& radiosity);

}  // namespace interflect
