#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "interflect/formfactor/kernel.h"

namespace interflect {

/// What the user asks of the form factors.
struct Accuracy {
  double eps = 5e-3;  ///< the rms error of a patch's row sum that sampling may leave
};

/// "low" (2e-2), "medium" (5e-3), "high" (1e-3) or a number in (0, 0.5]. Throws a usage Error that names the text.
[[nodiscard]] Accuracy accuracy_of(std::string_view text);

/// The shortest text that accuracy_of() reads back as the same: "medium", "0.003".
[[nodiscard]] std::string text_of(const Accuracy& accuracy);

/// The numbers that the decisions of a tile follow, on every device. Rays are given by F = S / min(A_i, A_j), the
/// larger of the pair's two form factors. n random rays would leave an error of F sqrt(v (1 − v) / n) in F, v the
/// visible share; stratified ones leave less. With n = rays_per_factor F the squares add up, over a row that is all
/// half-hidden, to 0.25 / rays_per_factor = eps². The defaults are those of medium.
struct RayBudget {
  float pilot_per_factor = 2000;  ///< first rays: F times this, rounded up, 1 to most_in_pilot
  float rays_per_factor = 10000;  ///< all rays, rounded down, where the first ones or the neighbours disagree
  std::uint32_t most_in_pilot = 64;
  std::uint32_t fewest_when_mixed = 4;  ///< rays of a pair that is mixed, and of each piece of one that is cut
  std::uint32_t most = 8192;
  float split_from = 0.01F;  ///< near, mixed pairs with F of at least this are cut into pieces with rays of their own
  kernel::Ratios ratios;     ///< from which quadrature does
  float three_points_error = 2e-4F, six_points_error = 5e-5F;  ///< rms, as shares of S, that it leaves there
};

/// The budget whose rays leave at most about accuracy.eps.
[[nodiscard]] RayBudget budget_of(const Accuracy& accuracy);

}  // namespace interflect
