#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "interflect/formfactor/embree_tiles.h"
#include "interflect/schedule/device_form_factors.h"

namespace interflect::test {

/// In place of the kernels that assemble S on a device: Embree's S of a mesh, computed once and uploaded. What the
/// device makes of it must then be what the host makes of it.
inline DeviceFormFactors::Assemble embree_on_device(const PatchMesh& mesh, const AssemblyOptions& options) {
  struct Made {
    FormFactorMatrix s;
    TileFacts facts;
  };
  auto made = std::make_shared<Made>();
  made->s = FormFactorMatrix(static_cast<std::uint32_t>(mesh.size()));
  const PatchTable patches(mesh);
  const Blockers blockers(mesh, patches);
  ProgressSink silent;
  EmbreeTiles tiles(patches, blockers, options.budget, options.seed);
  FormFactorMatrix& s = made->s;
  const TileSink store = [&](std::size_t r, std::size_t c, std::span<const float> tile) {
    for (std::uint32_t k = 0; k < 32 * 32; ++k) {
      const auto i = static_cast<std::uint32_t>(32 * r + k / 32), j = static_cast<std::uint32_t>(32 * c + k % 32);
      if (i >= j || j >= s.size()) continue;
      s.row(i)[j] = s.row(j)[i] = tile[k];
    }
  };
  made->facts = tiles.make(0, patches.blocks(), store, silent);
  return [made](Device& device, const PatchTable&, const Blockers&, const AssemblyOptions&,
                std::span<const DevicePanel> panels, std::uint32_t stride, ProgressSink&) {
    for (const DevicePanel& panel : panels) {
      for (std::uint32_t i = 0; i < panel.rows; ++i) {
        device.queue().upload(*panel.buffer, std::size_t{i} * stride * sizeof(float),
                              std::as_bytes(std::as_const(made->s).row(panel.first + i)));
      }
    }
    DeviceAssemblyFacts facts;
    facts.pairs_considered = made->facts.pairs_considered;
    facts.pairs_analytic = made->facts.pairs_analytic;
    facts.rays = made->facts.rays;
    facts.tile_variance = made->facts.variance;
    return facts;
  };
}

}  // namespace interflect::test
