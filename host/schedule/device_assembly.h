#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/device/device.h"
#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/patch_table.h"

namespace interflect {

/// Rows [first, first + rows) of S in a buffer of a device: dense fp32 rows. Rows of several panels do not overlap.
struct DevicePanel {
  std::uint32_t first = 0, rows = 0;
  Buffer* buffer = nullptr;
};

struct DeviceAssemblyFacts {
  std::uint64_t pairs_considered = 0;  ///< i < j that face each other, at least in part
  std::uint64_t pairs_analytic = 0;    ///< of them by the contour form
  std::uint64_t rays = 0;              ///< shadow rays traced
  /// Σ over the pairs of a tile of σ²(S_ij) / (A_i A_j): the tiles (r, c) of the given row blocks, c >= r, by rows.
  std::vector<float> tile_variance;
  double seconds = 0;
};

/// How a device is driven; no result depends on it.
struct DevicePace {
  double launch_seconds = 0.05;       ///< aimed at for a batch of tiles, and for a launch of rays
  std::uint32_t first_tiles = 16;     ///< of the first batch
  std::uint32_t most_tiles = 0;       ///< of any batch; 0: what 128 MiB of scratch hold
};

/// Computes S_ij on a device for the pairs i < j of the tiles (r, c), first_row_block <= r < end_row_block, c >= r, and
/// writes S_ij and S_ji wherever a panel has the row, `stride` floats (a multiple of 16, at least the number of
/// patches) from row to row. What is 0 (the diagonal, padding, pairs that do not face each other) may not be written:
/// the buffers come filled with zeros, as allocate() gives them. Host work beside it: culling of whole tiles.
/// The same algorithm and samples as PairTile, in single precision. Throws what the device throws; an Error of kind
/// device where its buffers are too small.
[[nodiscard]] DeviceAssemblyFacts assemble_on(Device& device, const PatchTable& patches, const Blockers& blockers,
                                              const RayBudget& budget, std::uint64_t seed,
                                              std::span<const DevicePanel> panels, std::uint32_t stride,
                                              std::uint32_t first_row_block, std::uint32_t end_row_block,
                                              ProgressSink& progress, const DevicePace& pace = {});

}  // namespace interflect
