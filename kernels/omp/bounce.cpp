#include <bit>
#include <cstdint>

#include "omp/blocks.h"

namespace interflect::omp {

namespace {

/// The norms that matter are near 1; below this a value is as good as zero, and a denormal one costs a hundred cycles.
/// Compared as whole numbers, since a comparison of floats that may trap is not vectorized.
float flushed(float value) {
  constexpr auto smallest = std::bit_cast<std::int32_t>(1e-30F);
  const auto bits = std::bit_cast<std::int32_t>(value);
  return std::bit_cast<float>((bits & 0x7FFFFFFF) < smallest ? 0 : bits);
}

}  // namespace

void bounce(const Launch& launch) {
  const Vectors v(launch);
  const float* y = v.floats(0);
  const float* rho = v.floats(1);
  const float* d = v.floats(2);
  float* r = v.floats(3);
  float* x = v.floats(4);
  float* sums = v.floats(5);
  const float keep = v.arguments().option == 1 ? 1.0F : 0.0F;
  v.for_each_block([=, &v](const Block& block) {
    const auto [rr, gamma] = block_sums<2>(block, [=](std::uint64_t i, auto add) {
      const float bounced = flushed(rho[i] * y[i]);
      r[i] = bounced;
      x[i] += keep * bounced;
      add(0, bounced * bounced);
      add(1, d[i] * bounced * bounced);
    });
    v.partial(sums, sum::rr, block.column, block.index) = rr;
    v.partial(sums, sum::gamma, block.column, block.index) = gamma;
  });
}

}  // namespace interflect::omp
