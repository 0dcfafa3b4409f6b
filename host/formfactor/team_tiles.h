#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Several makers of one kind, each driven by a thread of its own: they take runs of tile rows one after the other, so
/// that the faster does more. S and facts are those of one maker, whoever made which tile: S is a pure function for
/// makers of one kind. A maker that throws a device Error is left out, and its run is made by another.
class TeamTiles final : public TileMaker {
 public:
  /// Told of a maker that is left out, one call at a time.
  using Lost = std::function<void(std::size_t maker, const Error& error)>;

  /// `blocks`: tile rows of S in all.
  TeamTiles(std::vector<std::unique_ptr<TileMaker>> makers, std::size_t blocks, Lost lost);

  /// Throws the last maker's device Error when none is left, and at once whatever else a maker throws. Progress is
  /// advanced as runs are finished. The sink may be called for a tile again, with the same S, when a maker was left
  /// out.
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& progress) override;

 private:
  struct Runs;
  void work(std::size_t maker, Runs& runs, const TileSink& sink, ProgressSink& progress);

  std::vector<std::unique_ptr<TileMaker>> makers_;  ///< null: left out
  std::size_t blocks_;
  Lost lost_;
};

}  // namespace interflect
