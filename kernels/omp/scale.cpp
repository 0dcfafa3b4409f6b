#include <cstdint>

#include "omp/blocks.h"

namespace interflect::omp {

void scale(const Launch& launch) {
  const Vectors v(launch);
  const float* x = v.floats(0);
  const float* s = v.floats(1);
  float* out = v.floats(2);
  v.for_each_block([=, &v](const Block& block) {
    const std::uint64_t offset = std::uint64_t{block.column} * v.arguments().vector_stride;
#pragma omp simd
    for (std::uint64_t i = block.begin; i < block.end; ++i) out[i] = s[i - offset] * x[i];
  });
}

}  // namespace interflect::omp
