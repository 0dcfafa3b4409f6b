#include "omp/blocks.h"

namespace interflect::omp {

void dot(const Launch& launch) {
  const Vectors v(launch);
  const float* x = v.vector(0, "x");
  const float* y = v.vector(1, "y");
  float* sums = v.sums(2);
  const std::uint32_t set = v.arguments().option;
  if (set >= sum_sets) throw KernelRefusal{"no such set of sums"};
  v.for_each_block([=, &v](const Block& block) {
    const auto [xy] = block_sums<1>(block, [=](std::uint64_t i, auto add) { add(0, x[i] * y[i]); });
    v.partial(sums, set, block.column, block.index) = xy;
  });
}

void reduce(const Launch& launch) {
  const Vectors v(launch);
  float* sums = v.sums(0);
  const VectorArguments& a = v.arguments();
  if (a.option >= sum_sets || a.slot >= scalar_slots) throw KernelRefusal{"no such set of sums or slot"};
  for (std::uint32_t column = 0; column < a.columns; ++column) {
    v.scalar(sums, a.slot, column) = v.total(sums, a.option, column);
  }
}

}  // namespace interflect::omp
