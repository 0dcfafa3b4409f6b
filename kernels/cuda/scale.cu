#include "blocks.cuh"

// Contract: kernels/README.md.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    scale(const float* __restrict__ x, const float* __restrict__ s, float* __restrict__ xs, const VectorArguments a) {
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const Four si = load(s, in_column(a, block));
    Four xi = load(x, block);
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) xi.v[k] *= si.v[k];
    store(xs, block, xi);
  }
}
