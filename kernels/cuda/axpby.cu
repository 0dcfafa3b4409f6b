#include "blocks.cuh"

// Contract: kernels/README.md.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    axpby(const float* x, float* y, float* sums, const VectorArguments a) {
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const float of_x = scalar(a, sums, slot_axpby_a, block.column);
    const float of_y = scalar(a, sums, slot_axpby_b, block.column);
    const Four xi = load(x, block);
    Four yi = load(y, block);
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) yi.v[k] = of_x * xi.v[k] + of_y * yi.v[k];
    store(y, block, yi);
  }
}
