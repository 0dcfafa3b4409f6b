#include "omp/blocks.h"

namespace interflect::omp {

void dot(const Launch& launch) {
  const Vectors v(launch);
  const float* x = v.floats(0);
  const float* y = v.floats(1);
  float* sums = v.floats(2);
  const std::uint32_t set = v.arguments().option;
  v.for_each_block([=, &v](const Block& block) {
    const auto [xy] = block_sums<1>(block, [=](std::uint64_t i, auto add) { add(0, x[i] * y[i]); });
    v.partial(sums, set, block.column, block.index) = xy;
  });
}

void reduce(const Launch& launch) {
  const Vectors v(launch);
  float* sums = v.floats(0);
  const VectorArguments& a = v.arguments();
  for (std::uint32_t column = 0; column < a.columns; ++column) {
    v.scalar(sums, a.slot, column) = v.total(sums, a.option, column);
  }
}

}  // namespace interflect::omp
