#include "omp/blocks.h"

namespace interflect::omp {

void axpby(const Launch& launch) {
  const Vectors v(launch);
  const float* x = v.floats(0);
  float* y = v.floats(1);
  float* sums = v.floats(2);
  v.for_each_block([=, &v](const Block& block) {
    const float a = v.scalar(sums, slot::axpby_a, block.column);
    const float b = v.scalar(sums, slot::axpby_b, block.column);
#pragma omp simd
    for (std::uint64_t i = block.begin; i < block.end; ++i) y[i] = a * x[i] + b * y[i];
  });
}

}  // namespace interflect::omp
