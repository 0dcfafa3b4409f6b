#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/sampling.h"

namespace interflect {

/// Shadow rays on their way to Embree, one array per coordinate: origin + t direction, 0 < t < 1. Each counts with its
/// weight towards a slot of the caller's.
struct ShadowRays {
  static constexpr std::size_t most = 4096;
  static constexpr std::size_t slack = 64;  ///< floats behind them that SIMD stores may overwrite

  std::array<std::vector<float>, 3> origin, direction;
  std::vector<float> near, far;  ///< 0; 1, and after Visibility::occluded() below 0 where something was met
  std::vector<float> weight;
  std::vector<std::uint32_t> slot;
  std::size_t size = 0;

  ShadowRays() {
    for (auto* three : {&origin, &direction}) {
      for (auto& one : *three) one.assign(most + slack, 0);
    }
    near.assign(most + slack, 0);
    far.assign(most + slack, 0);
    weight.assign(most + slack, 0);
    slot.assign(most + slack, 0);
  }
  [[nodiscard]] std::size_t room() const { return most - size; }
};

/// The whole patches of a block as facets, one array per coordinate, with their words.
struct FacetBlock {
  static constexpr std::size_t block = PatchTable::block;
  std::array<std::array<float, block>, 12> of{};  ///< corner, first edge, second edge, normal: x y z each
  std::array<std::uint32_t, block> u{}, v{};
  void set(std::size_t k, const sampling::Facet& facet, sampling::Square word);
};

/// What the rays of a pair, or of a piece of it, run between and are counted into.
struct RayStream {
  const sampling::Facet &a, &b;
  sampling::Square from, to;
  std::uint32_t slot;
  bool weighted;  ///< with cosθ_x cosθ_y / r²; otherwise 1
};

/// Which first rays a row of pairs wants.
enum class FirstRay : std::uint32_t { none, plain, weighted };

/// sampling::shadow_ray() in SIMD through Highway with run-time dispatch. Both append to `out`; rays of weight 0 are
/// left out.
namespace simd {

/// Ray number 0 of patch a against the patches of a block, slots slot, slot + 1, ...; `start_a` and `i` are a's word
/// and number, `first` the number of the block's first patch. Needs room for a block.
void first_rays(const sampling::Facet& a, sampling::Square word_a, std::uint32_t i, const FacetBlock& columns,
                std::uint32_t first, const std::array<FirstRay, FacetBlock::block>& wanted, std::uint32_t slot,
                float lift, ShadowRays& out);

/// Rays number first .. first + count − 1. Needs room for them.
void rays_of(const RayStream& stream, std::uint32_t first, std::uint32_t count, float lift, ShadowRays& out);

}  // namespace simd
}  // namespace interflect
