#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/kernel.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/sampling.h"
#include "interflect/formfactor/shadow_rays.h"
#include "interflect/formfactor/simd.h"
#include "interflect/formfactor/visibility.h"

namespace interflect {

/// Computes S for all pairs of two blocks of patches. One worker per thread; it owns all the memory it needs.
class PairTile {
 public:
  static constexpr std::size_t block = PatchTable::block;

  PairTile(const PatchTable& patches, const Blockers& blockers, std::uint64_t seed, const RayBudget& budget = {});

  /// S for i in block `rows` and j in block `columns` >= rows; within one block only i < j. False: all of it is 0.
  [[nodiscard]] bool compute(std::size_t rows, std::size_t columns);
  /// S of the a-th patch of the row block with the b-th of the column block.
  [[nodiscard]] double s(std::size_t a, std::size_t b) const { return s_[a * block + b]; }
  /// Σ σ²(S_ij) / (A_i A_j) over the pairs of the last tile: what rays and quadrature are expected to leave of S.
  /// σ²(F_ij) is a term times A_j / A_i. With V the visible share of the pair's exchange, p the share of its n rays
  /// that ended early (by weight; n = (Σ w)² / Σ w²) and S what it would be unoccluded:
  ///   σ²(S_ij) = S² σ²(V) + S² (RayBudget::three_points_error or six_points_error)²
  ///   σ²(V)    = p (1 − p) / (n − 1)                    from two rays on: unbiased for random rays
  ///            = Σ (p' − p)² / (2 m n)                  one ray: over the m <= 4 pairs beside it in the tile that have
  ///                                                     rays, p' after their first ones; 1 / 6 where m = 0
  ///            = Σ_k s_k² σ²(V_k) / (Σ_k s_k)²          a cut pair; a piece with one ray counts V (1 − V) of the pair
  /// and 0 where the shaft is empty. Rays are stratified, so that the true error is mostly somewhat less.
  [[nodiscard]] double variance() const { return static_cast<double>(variance_); }

  // Counted since construction.
  [[nodiscard]] std::uint64_t considered() const { return considered_; }
  [[nodiscard]] std::uint64_t analytic() const { return analytic_; }
  [[nodiscard]] std::uint64_t rays() const { return rays_; }
  /// Seconds that this worker spent inside Embree.
  [[nodiscard]] double trace_seconds() const { return trace_seconds_; }

 private:
  /// Rays are counted into slots: 0 .. block² − 1 are the pairs, those behind are pieces of pairs that were cut, in
  /// the order of the pairs.
  struct Slot {
    float hidden = 0, total = 0;  ///< Σ w
    float squares = 0;            ///< Σ w²
    [[nodiscard]] float hidden_share() const { return total > 0 ? hidden / total : 0; }
  };
  /// A pair whose V is the mean over the slots [first, first + s.size()) weighted by s.
  struct CutPair {
    std::size_t pair, first;
    std::vector<double> s;
  };
  /// The parts of two patches in front of each other's planes.
  struct Parts {
    sampling::Facet a, b;
  };

  // pair_tile.cpp: which pairs there are, and S without occlusion
  void find_kinds(std::size_t rows, std::size_t columns);
  void finish_kind(std::size_t pair);
  [[nodiscard]] const kernel::Samples& six_points(kernel::Samples& kept, std::size_t patch) const;
  [[nodiscard]] bool anything_between(std::size_t rows, std::size_t columns);
  void hide();

  // pair_rays.cpp: what is hidden of them
  void load_facets();
  void find_factors();
  void trace_pilot();
  [[nodiscard]] bool trace_mixed();
  void trace_cut(std::size_t pair);
  void add_rays(const RayStream& stream, std::uint32_t first, std::uint32_t count);
  void add_rays_of_pair(std::size_t pair, std::uint32_t first, std::uint32_t count);
  void flush();
  [[nodiscard]] bool disagrees(std::size_t pair) const;
  [[nodiscard]] std::uint32_t pilot_rays(float factor) const;
  [[nodiscard]] std::uint32_t all_rays(float factor) const;

  // pair_error.cpp
  void add_quadrature_variance();
  void add_ray_variance();
  [[nodiscard]] static float variance_of(const Slot& slot, float spread);
  [[nodiscard]] float variance_of_cut(const CutPair& cut) const;
  [[nodiscard]] float spread_beside(std::size_t pair) const;
  /// S² / (A_i A_j) without occlusion.
  [[nodiscard]] float squared_factor(std::size_t pair) const;

  [[nodiscard]] std::size_t row_patch(std::size_t pair) const { return first_row_ + pair / block; }
  [[nodiscard]] std::size_t column_patch(std::size_t pair) const { return first_column_ + pair % block; }
  [[nodiscard]] kernel::Polygon whole(std::size_t patch) const { return kernel::Polygon(patches_.triangle(patch)); }
  [[nodiscard]] kernel::Polygon part_in_front(std::size_t patch, std::size_t other) const {
    return kernel::clip(patches_.triangle(patch), patches_.plane(other),
                        patches_.tolerance[patch] + patches_.tolerance[other]);
  }

  const PatchTable& patches_;
  const Blockers& blockers_;
  std::uint64_t seed_;
  RayBudget budget_;
  float lift_;  ///< rays start and end this far above their patches
  std::vector<Box> boxes_;
  std::size_t hint_ = 0;  ///< of Blockers::any_in()
  std::size_t first_row_ = 0, first_column_ = 0;
  std::array<sampling::Facet, block> row_facet_, column_facet_;
  std::array<sampling::Square, block> row_word_, column_word_;
  FacetBlock columns_;
  std::array<kernel::Samples, block> row_points_, column_points_;  ///< 6 each, made when asked for: size 0 before
  std::vector<double> s_;
  std::vector<simd::PairKind> kind_;
  std::vector<std::uint16_t> there_;     ///< the pairs whose kind is not none
  std::vector<float> factor_;            ///< S / min(A_i, A_j), the larger of the pair's form factors
  std::vector<std::uint32_t> pilot_;     ///< rays that the pair gets first
  std::vector<float> hidden_;            ///< share of them that ended early
  std::vector<std::uint16_t> parts_of_;  ///< a straddling pair's place in parts_
  std::vector<Parts> parts_;
  std::vector<Slot> slots_;
  std::vector<CutPair> cut_;
  ShadowRays pending_;
  float variance_ = 0;
  double trace_seconds_ = 0;
  std::uint64_t considered_ = 0, analytic_ = 0, rays_ = 0;
};

}  // namespace interflect
