#pragma once

#include <cstdint>

#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/pair_tile.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Tiles of S on the CPU: OpenMP over tiles, visibility through Embree. Patches and blockers must outlive it.
class EmbreeTiles final : public TileMaker {
 public:
  EmbreeTiles(const PatchTable& patches, const Blockers& blockers, const RayBudget& budget, std::uint64_t seed)
      : patches_(patches), blockers_(blockers), budget_(budget), seed_(seed) {}
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& progress) override;

 private:
  const PatchTable& patches_;
  const Blockers& blockers_;
  RayBudget budget_;
  std::uint64_t seed_;
};

}  // namespace interflect
