#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/device/device.h"
#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/tile_maker.h"

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
  double launch_seconds = 0.05;    ///< aimed at for a batch of tiles, and for a launch of rays
  std::uint32_t first_tiles = 16;  ///< of the first batch
  std::uint32_t most_tiles = 0;    ///< of any batch; 0: what 128 MiB of scratch hold
  std::uint32_t most_chunks = 0;   ///< of up to 8 rays, that a batch may list; 0: what 128 MiB of scratch hold
};

/// The assembly of S on one device: the same algorithm and samples as PairTile, in single precision
/// (kernels/README.md). Device, patches and blockers must outlive it; one thread at a time may use it. Everything
/// throws what the device throws, and a device Error where its buffers are too small.
class DeviceAssembly final : public TileMaker {
 public:
  /// Uploads the patches and a hierarchy over the blockers, and compiles the kernels.
  DeviceAssembly(Device& device, const PatchTable& patches, const Blockers& blockers, const RayBudget& budget,
                 std::uint64_t seed, const DevicePace& pace = {});
  ~DeviceAssembly() override;

  /// S by tiles to the host, batch by batch.
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& progress) override;
  /// Bytes of S that make() has brought to the host so far.
  [[nodiscard]] std::uint64_t downloaded_bytes() const { return downloaded_bytes_; }

  /// S_ij for the pairs i < j of the tiles (r, c), first <= r < end, c >= r: S_ij and S_ji go wherever a panel has the
  /// row, `stride` floats (a multiple of 16, at least the number of patches) from row to row. What is 0 (the diagonal,
  /// padding, pairs that do not face each other) may not be written: the buffers come filled with zeros, as allocate()
  /// gives them. Progress is advanced by the number of tiles.
  [[nodiscard]] DeviceAssemblyFacts into(std::span<const DevicePanel> panels, std::uint32_t stride, std::size_t first,
                                         std::size_t end, ProgressSink& progress);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
  std::uint64_t downloaded_bytes_ = 0;
};

/// DeviceAssembly::into() once.
[[nodiscard]] DeviceAssemblyFacts assemble_on(Device& device, const PatchTable& patches, const Blockers& blockers,
                                              const RayBudget& budget, std::uint64_t seed,
                                              std::span<const DevicePanel> panels, std::uint32_t stride,
                                              std::uint32_t first_row_block, std::uint32_t end_row_block,
                                              ProgressSink& progress, const DevicePace& pace = {});

}  // namespace interflect
