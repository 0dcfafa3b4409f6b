#include "blocks.cuh"

// Contracts: kernels/README.md.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    dot(const float* x, const float* y, float* sums, const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const Four xi = load(x, block), yi = load(y, block);
    float xy[1] = {};
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) {
      if (k < block.count) xy[0] += xi.v[k] * yi.v[k];
    }
    write_partials(a, sums, block, xy, {a.option}, shared);
  }
}

extern "C" __global__ void __launch_bounds__(WORKGROUP) reduce(float* sums, const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    if (block.index != 0) continue;
    float total[1];
    add_totals(a, sums, block.column, {a.option}, total, shared);
    if (threadIdx.x == 0) scalar(a, sums, a.slot, block.column) = total[0];
  }
}
