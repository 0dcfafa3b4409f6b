#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/base/ranks.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/rank_store.h"
#include "interflect/formfactor/row_shares.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Fills each rank's rows of S: rounds in which every rank makes a run of tile rows, and all then exchange what the
/// others own.
class RankFill {
 public:
  /// Of what is given all must outlive this. `store`: null, or one whose load() has been called for `rows`. No rank is
  /// sent more than about `most_bytes` at a time by all others together.
  RankFill(Ranks& ranks, const std::vector<RowShare>& shares, FormFactorMatrix& rows, TileMaker& maker,
           RankStore* store, std::uint64_t most_bytes = std::uint64_t{256} << 20);

  /// Collective. Adds the facts of the tiles to rank 0's report. Advances the progress by tiles of all ranks, about.
  void run(AssemblyReport& report, ProgressSink& progress);

  /// Tiles that will be made.
  [[nodiscard]] std::uint64_t tiles() const;

 private:
  struct Run {
    std::uint32_t first = 0, end = 0;  ///< tile rows
  };
  struct Facts {
    std::uint32_t first = 0, end = 0;
    TileFacts facts = {};
  };
  void plan();
  void send(std::uint32_t r, std::uint32_t c, std::span<const float> tile);
  void send(const Facts& facts);
  void exchange();
  void take(std::span<const std::byte> records);
  void put(std::uint32_t r, std::uint32_t c, std::span<const float> tile);
  void note(Facts facts);
  void save_finished(std::uint32_t runs_done);
  [[nodiscard]] std::vector<std::uint32_t> finished(std::uint32_t runs_done);
  void add_stored(AssemblyReport& report) const;

  Ranks& ranks_;
  const std::vector<RowShare>& shares_;
  FormFactorMatrix& rows_;
  TileMaker& maker_;
  RankStore* store_;
  std::uint64_t most_bytes_;
  std::uint32_t blocks_;
  std::vector<Run> runs_;
  std::vector<std::vector<std::byte>> outbox_;
  std::vector<std::mutex> locks_;  ///< of the outboxes
  std::vector<Facts> facts_;       ///< on rank 0: of all runs; on a panel's owner: of its runs
  std::uint32_t next_panel_ = 0;   ///< those before are saved
};

}  // namespace interflect
