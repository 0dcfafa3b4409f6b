// Copies memory past the caches: with `read`, a device's bandwidth. Contract: kernels/README.md.
//
// Memory traffic of a launch: 64 * lines bytes read and as many written (stores that do not read the line first).

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "omp/copy.cpp"  // once per instruction set
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::omp::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

HWY_ATTR void copy_floats(const float* HWY_RESTRICT from, float* HWY_RESTRICT to, std::size_t count) {
  const hn::CappedTag<float, 16> d;
  for (std::size_t i = 0; i < count; i += hn::MaxLanes(d)) hn::Stream(hn::Load(d, from + i), d, to + i);
  hwy::FlushStream();
}

}  // namespace interflect::omp::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect::omp {

HWY_EXPORT(copy_floats);

void copy(const Launch& launch) {
  constexpr std::uint64_t chunk = std::uint64_t{1} << 20;  // floats
  const std::uint64_t count = std::uint64_t{launch.arguments<StreamArguments>().lines} * 16;
  const float* from = launch.floats(0);
  float* to = launch.floats(1);
#pragma omp parallel for schedule(static)
  for (std::uint64_t first = 0; first < count; first += chunk) {
    HWY_DYNAMIC_DISPATCH(copy_floats)(from + first, to + first, std::min(chunk, count - first));
  }
}

}  // namespace interflect::omp

#endif
