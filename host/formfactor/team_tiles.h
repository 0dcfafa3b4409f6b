#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Several makers, each driven by a thread of its own: they take runs of tile rows one after the other, so that the
/// faster does more; or each those that its share says. With makers of one kind S and facts are those of one maker,
/// whoever made which tile: S is a pure function then. Those of several kinds differ in rays that graze an edge, and S
/// is the same again only with the same shares. A maker that throws a device Error is left out, and others make its
/// runs.
class TeamTiles final : public TileMaker {
 public:
  /// Told of a maker that is left out, one call at a time.
  using Lost = std::function<void(std::size_t maker, const Error& error)>;

  /// `blocks`: tile rows of S in all. `shares`: of the tiles, one for each maker, their sum above 0; empty: as it
  /// comes.
  TeamTiles(std::vector<std::unique_ptr<TileMaker>> makers, std::size_t blocks, Lost lost,
            std::vector<double> shares = {});

  /// Throws the last maker's device Error when none is left, and at once whatever else a maker throws. Progress is
  /// advanced as runs are finished. The sink may be called for a tile again, with the same S, when a maker was left
  /// out.
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& progress) override;

 private:
  struct Runs;
  void deal(Runs& runs) const;
  void hand_on(std::size_t maker, Runs& runs) const;
  void work(std::size_t maker, Runs& runs, const TileSink& sink, ProgressSink& progress);

  std::vector<std::unique_ptr<TileMaker>> makers_;  ///< null: left out
  std::size_t blocks_;
  Lost lost_;
  std::vector<double> shares_;
};

}  // namespace interflect
