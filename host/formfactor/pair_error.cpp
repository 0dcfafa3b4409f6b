#include <algorithm>
#include <cstddef>

#include "interflect/formfactor/pair_tile.h"

// PairTile's estimate of its own error (PairTile::variance()), in single precision as the kernels of the devices do it.

namespace interflect {

using simd::PairKind;

namespace {

// Rays, by their weights, from which the pair's own spread is used: below, it has none.
constexpr float own_spread_from = 1.5F;

// E[v (1 − v)] of a visible share of which a single ray is known and nothing else.
constexpr float unknown_spread = 1.0F / 6;

}  // namespace

/// σ² of a mean over rays: the unbiased p (1 − p) / (n − 1), n being (Σ w)² / Σ w²; of a single ray `spread`, which is
/// an estimate of v (1 − v).
float PairTile::variance_of(const Slot& slot, float spread) {
  const float p = slot.hidden / slot.total, n = slot.total * slot.total / slot.squares;
  return n > own_spread_from ? std::max(0.0F, p * (1 - p)) / (n - 1) : spread / n;
}

/// v (1 − v) of a pair with a single ray: half the mean square difference from the pairs beside it in the tile, since
/// of two such rays the expected square is v (1 − v') + v' (1 − v).
float PairTile::spread_beside(std::size_t pair) const {
  const std::size_t a = pair / block, b = pair % block;
  float squares = 0, count = 0;
  const auto look = [&](bool inside, std::size_t other) {
    if (!inside || kind_[other] == PairKind::none) return;
    const float difference = hidden_[other] - hidden_[pair];
    squares += difference * difference;
    count += 1;
  };
  look(a > 0, pair - block);
  look(a + 1 < block, pair + block);
  look(b > 0, pair - 1);
  look(b + 1 < block, pair + 1);
  return count > 0 ? 0.5F * squares / count : unknown_spread;
}

float PairTile::squared_factor(std::size_t pair) const {
  return static_cast<float>(s_[pair] / patches_.area[row_patch(pair)]) *
         static_cast<float>(s_[pair] / patches_.area[column_patch(pair)]);
}

/// From the rays of every pair; s_ is still without occlusion.
void PairTile::add_ray_variance() {
  std::size_t next_cut = 0;
  for (const std::size_t pair : there_) {
    float of_share = 0;
    if (next_cut < cut_.size() && cut_[next_cut].pair == pair) {
      of_share = variance_of_cut(cut_[next_cut++]);
    } else if (slots_[pair].total > 0) {
      of_share = variance_of(slots_[pair], pilot_[pair] == 1 ? spread_beside(pair) : 0);
    }
    if (of_share > 0) variance_ += of_share * squared_factor(pair);
  }
}

/// Σ s_k² σ²(V_k) / (Σ s_k)² over the pieces; of a piece with one ray the pair's own V (1 − V) is taken.
float PairTile::variance_of_cut(const CutPair& cut) const {
  float sum = 0, hidden = 0, squares = 0;
  for (std::size_t k = 0; k < cut.s.size(); ++k) {
    sum += static_cast<float>(cut.s[k]);
    hidden += static_cast<float>(cut.s[k]) * slots_[cut.first + k].hidden_share();
  }
  if (!(sum > 0)) return 0;
  const float share = hidden / sum;
  for (std::size_t k = 0; k < cut.s.size(); ++k) {
    const Slot& slot = slots_[cut.first + k];
    const float part = static_cast<float>(cut.s[k]) / sum;
    if (slot.total > 0) squares += part * part * variance_of(slot, share * (1 - share));
  }
  return squares;
}

/// Adds what quadrature leaves of the pairs whose S comes from it.
void PairTile::add_quadrature_variance() {
  const float far = budget_.three_points_error * budget_.three_points_error,
              middle = budget_.six_points_error * budget_.six_points_error;
  for (const std::size_t pair : there_) {
    const float of_share = kind_[pair] == PairKind::far ? far : kind_[pair] == PairKind::middle ? middle : 0;
    if (of_share > 0) variance_ += of_share * squared_factor(pair);
  }
}

}  // namespace interflect
