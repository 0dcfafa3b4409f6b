#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/visibility.h"

namespace interflect {

/// Where cosine-distributed rays from each patch end: shares of its own rays.
struct HemisphereShares {
  std::vector<float> escape;  ///< that leave the scene
  std::vector<float> back;    ///< that end on the back of a surface

  /// Σ A_i share_i / Σ A_i over the patches that count.
  [[nodiscard]] static double mean(const PatchTable& patches, const std::vector<float>& share,
                                   const std::vector<bool>& counts);
};

/// Traces rays_for(patches.size) rays from each patch, stratified over the patch and the hemisphere.
/// `two_sided[t]` says whether triangle t of `visibility` has a front on both sides.
[[nodiscard]] HemisphereShares look_around(const PatchTable& patches, const Visibility& visibility,
                                           const std::vector<bool>& two_sided, std::uint64_t seed);

/// 32 rays a patch, more in small scenes, so that a small hole is found there too.
[[nodiscard]] std::uint32_t hemisphere_rays(std::size_t patches);

}  // namespace interflect
