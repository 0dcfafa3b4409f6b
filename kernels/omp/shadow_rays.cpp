// Which rays meet a triangle of a hierarchy, with the code that the GPUs run. The assembly on the processor asks Embree
// (host/formfactor/visibility.h): this kernel is what the others are compared with. Contract: kernels/README.md.

#include <cstdint>

#include "interflect/device/kernel_arguments.h"
#include "omp/shared.h"
#include "omp/table.h"

namespace interflect::omp {

namespace shared {

#include "shared/occluded.h"

}  // namespace shared

void shadow_rays(const Launch& launch) {
  using shared::vec4;
  const auto a = launch.arguments<ShadowRayArguments>();
  const auto* hierarchy_nodes = launch.pointer<shared::uvec4>(0);
  const auto* hierarchy_leaves = launch.pointer<vec4>(1);
  const auto* rays = launch.pointer<vec4>(2);
  auto* hidden = launch.pointer<std::uint32_t>(3);
#pragma omp parallel for schedule(dynamic, 256)
  for (std::uint32_t i = 0; i < a.rays; ++i) {
    const vec4 from = rays[2 * std::size_t{i}], to = rays[2 * std::size_t{i} + 1];
    hidden[i] = shared::occluded(HIERARCHY{from.x, from.y, from.z}, {to.x, to.y, to.z}, from.w, to.w) ? 1U : 0U;
  }
}

}  // namespace interflect::omp
