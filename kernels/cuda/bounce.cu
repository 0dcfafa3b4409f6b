#include "blocks.cuh"

// Contract: kernels/README.md. Denormal values cost a GPU nothing, so that none is set to 0.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    bounce(const float* y, const float* rho, const float* d, float* r, float* x, float* sums, const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const Four yi = load(y, block), rhoi = load(rho, block), di = load(d, block);
    Four ri = {};
    float part[2] = {};
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) {
      if (k >= block.count) continue;
      ri.v[k] = rhoi.v[k] * yi.v[k];
      part[0] += ri.v[k] * ri.v[k];
      part[1] += di.v[k] * ri.v[k] * ri.v[k];
    }
    store(r, block, ri);
    if (a.option == 1) {
      Four xi = load(x, block);
#pragma unroll
      for (unsigned k = 0; k < 4; ++k) xi.v[k] += ri.v[k];
      store(x, block, xi);
    }
    write_partials(a, sums, block, part, {sum_rr, sum_gamma}, shared);
  }
}
