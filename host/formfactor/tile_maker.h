#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/formfactor/patch_table.h"

namespace interflect {

/// What is known of a run of tile rows besides S.
struct TileFacts {
  std::uint64_t pairs_considered = 0;  ///< i < j that face each other, at least in part
  std::uint64_t pairs_analytic = 0;    ///< of them by the contour form
  std::uint64_t rays = 0;              ///< shadow rays traced
  double trace_seconds = 0;            ///< inside Embree, a thread's share; 0 elsewhere, and for panels from a store
  /// Σ σ²(S_ij) / (A_i A_j) over the pairs of each tile (r, c), c >= r: for each tile row its tiles from the diagonal
  /// on, row after row. The sampling's variance: σ²(F_ij) is that times A_j / A_i.
  std::vector<float> variance;
};

/// Takes a tile (r, c), c >= r: S of patches 32 r + a and 32 c + b at s[32 a + b], 0 beyond the last patch; of a tile
/// on the diagonal only a < b counts. Called for each tile that is not all 0, once, from several threads at a time, for
/// different tiles.
using TileSink = std::function<void(std::size_t r, std::size_t c, std::span<const float> s)>;

/// Computes tiles of S. S is a pure function of geometry, accuracy and seed: not of the run of rows, of threads or of
/// the order of the tiles.
class TileMaker {
 public:
  TileMaker() = default;
  TileMaker(const TileMaker&) = delete;
  TileMaker& operator=(const TileMaker&) = delete;
  virtual ~TileMaker() = default;
  /// The tiles (r, c) with first <= r < end and c >= r. Progress is advanced by the number of tiles.
  [[nodiscard]] virtual TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                                       ProgressSink& progress) = 0;
};

/// Tiles in the rows [first, end), of `blocks` rows in all.
[[nodiscard]] constexpr std::uint64_t tiles_in_rows(std::uint64_t first, std::uint64_t end, std::uint64_t blocks) {
  const auto before = [blocks](std::uint64_t row) { return row == 0 ? 0 : row * blocks - row * (row - 1) / 2; };
  return before(end) - before(first);
}

}  // namespace interflect
