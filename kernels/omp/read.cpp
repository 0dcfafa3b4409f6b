// Reads memory as fast as the cores can: what every other kernel's rate is compared with. Contract: kernels/README.md.
//
// Memory traffic of a launch: 64 * lines bytes read, 4 * groups written.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "omp/read.cpp"  // once per instruction set
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <cstddef>
#include <cstdint>

#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

HWY_BEFORE_NAMESPACE();
namespace interflect::omp::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Σ data[i] over lines of 16 floats: as many streams as asked for are read side by side, each a contiguous part.
template <std::size_t streams>
HWY_ATTR float sum_streams(const float* HWY_RESTRICT data, std::size_t lines) {
  const hn::CappedTag<float, 16> d;
  constexpr std::size_t lanes = hn::MaxLanes(d);
  constexpr std::size_t vectors = 16 / streams;  // of each stream at once
  using Vector = hn::Vec<decltype(d)>;
  const std::size_t length = lines * (16 / lanes) / streams / vectors * vectors;  // vectors in a stream
  Vector sum[streams][vectors];
  HWY_UNROLL(16)
  for (std::size_t s = 0; s < streams; ++s) {
    HWY_UNROLL(16)
    for (std::size_t v = 0; v < vectors; ++v) sum[s][v] = hn::Zero(d);
  }
  for (std::size_t i = 0; i < length; i += vectors) {
    HWY_UNROLL(16)
    for (std::size_t s = 0; s < streams; ++s) {
      HWY_UNROLL(16)
      for (std::size_t v = 0; v < vectors; ++v) {
        sum[s][v] = hn::Add(sum[s][v], hn::Load(d, data + (s * length + i + v) * lanes));
      }
    }
  }
  Vector total = hn::Zero(d);
  for (const auto& of_stream : sum) {
    for (const Vector& v : of_stream) total = hn::Add(total, v);
  }
  for (std::size_t i = streams * length; i < lines * (16 / lanes); ++i) {
    total = hn::Add(total, hn::Load(d, data + i * lanes));
  }
  return hn::GetLane(hn::SumOfLanes(d, total));
}

HWY_ATTR float sum_lines(const float* data, std::size_t lines, int streams) {
  if (streams >= 8) return sum_streams<8>(data, lines);
  if (streams >= 4) return sum_streams<4>(data, lines);
  if (streams >= 2) return sum_streams<2>(data, lines);
  return sum_streams<1>(data, lines);
}

}  // namespace interflect::omp::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace interflect::omp {

HWY_EXPORT(sum_lines);

void read(const Launch& launch) {
  const std::uint64_t lines = launch.arguments<StreamArguments>().lines;
  const int streams = launch.macro("STREAMS");
  const std::uint64_t groups = launch.groups;
  const float* data = launch.floats(0);
  float* sums = launch.floats(1);
#pragma omp parallel for schedule(dynamic)
  for (std::uint64_t g = 0; g < groups; ++g) {
    const std::uint64_t first = lines * g / groups;
    sums[g] = HWY_DYNAMIC_DISPATCH(sum_lines)(data + first * 16, lines * (g + 1) / groups - first, streams);
  }
}

}  // namespace interflect::omp

#endif
