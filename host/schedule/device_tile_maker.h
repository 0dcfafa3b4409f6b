#pragma once

#include <cstdint>

#include "interflect/device/device.h"
#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Tiles of S that a device computes, for who wants S on the host: file, exports, 16-bit formats. Device, patches and
/// blockers must outlive it. Throws what assemble_on() throws.
class DeviceTileMaker final : public TileMaker {
 public:
  DeviceTileMaker(Device& device, const PatchTable& patches, const Blockers& blockers, const RayBudget& budget,
                  std::uint64_t seed)
      : device_(device), patches_(patches), blockers_(blockers), budget_(budget), seed_(seed) {}
  /// A run of rows at a time that fits a buffer of the device; each is downloaded and handed out.
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& progress) override;

 private:
  Device& device_;
  const PatchTable& patches_;
  const Blockers& blockers_;
  RayBudget budget_;
  std::uint64_t seed_;
};

}  // namespace interflect
