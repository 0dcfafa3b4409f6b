#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/kernel.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/sampling.h"
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

  // Counted since construction.
  [[nodiscard]] std::uint64_t considered() const { return considered_; }
  [[nodiscard]] std::uint64_t analytic() const { return analytic_; }
  [[nodiscard]] std::uint64_t rays() const { return rays_; }

 private:
  /// Rays are counted into slots: 0 .. block² − 1 are the pairs, those behind are pieces of pairs that were cut, in
  /// the order of the pairs.
  struct Slot {
    float hidden = 0, total = 0;
  };
  /// A pair whose V is the mean over the slots [first, first + s.size()) weighted by s.
  struct CutPair {
    std::size_t pair, first;
    std::vector<double> s;
  };

  void find_kinds(std::size_t rows, std::size_t columns);
  void finish_kind(std::size_t pair, std::size_t i, std::size_t j);
  void load_facets();
  [[nodiscard]] bool anything_between(std::size_t rows, std::size_t columns);
  void trace_pilot();
  void trace_mixed();
  void trace_cut(std::size_t pair);
  /// What the rays of a pair, or of a piece of it, run between and are counted into.
  struct Stream {
    const sampling::Facet &a, &b;
    sampling::Square from, to;
    std::size_t slot;
    bool weighted;
  };
  [[nodiscard]] Stream stream(const sampling::Facet& a, const sampling::Facet& b, std::size_t pair, std::size_t slot,
                              std::uint32_t piece, bool weighted) const;
  void add_rays(const Stream& stream, std::uint32_t first, std::uint32_t count);
  void add_rays_of_pair(std::size_t pair, std::uint32_t first, std::uint32_t count);
  void flush();
  [[nodiscard]] bool disagrees(std::size_t pair) const;
  [[nodiscard]] double hidden_share(std::size_t pair) const {
    return slots_[pair].total > 0 ? static_cast<double>(slots_[pair].hidden / slots_[pair].total) : 0;
  }
  [[nodiscard]] std::size_t row_patch(std::size_t pair) const { return first_row_ + pair / block; }
  [[nodiscard]] std::size_t column_patch(std::size_t pair) const { return first_column_ + pair % block; }
  [[nodiscard]] kernel::Polygon whole(std::size_t patch) const { return kernel::Polygon(patches_.triangle(patch)); }
  [[nodiscard]] kernel::Polygon part_in_front(std::size_t patch, std::size_t other) const {
    return kernel::clip(patches_.triangle(patch), patches_.plane(other));
  }
  [[nodiscard]] std::uint32_t pilot_rays(float factor) const;
  [[nodiscard]] std::uint32_t all_rays(float factor) const;

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
  std::vector<double> s_;
  std::vector<simd::PairKind> kind_;
  std::vector<float> factor_;         ///< S / min(A_i, A_j), the larger of the pair's form factors
  std::vector<std::uint32_t> pilot_;  ///< rays that the pair gets first
  std::vector<double> hidden_;        ///< share of them that ended early
  std::vector<Slot> slots_;
  std::vector<CutPair> cut_;
  std::vector<Visibility::Ray> pending_;
  std::vector<std::pair<std::uint32_t, float>> pending_slot_;  ///< slot and weight of each pending ray
  std::unique_ptr<bool[]> occluded_;
  std::uint64_t considered_ = 0, analytic_ = 0, rays_ = 0;
};

}  // namespace interflect
