#include "blocks.cuh"

// Contracts: kernels/README.md.

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    cg_product(float* w, const float* rho, const float* d, const float* r, float* sums, const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const Four rhoi = load(rho, block), di = load(d, block), ri = load(r, block);
    Four wi = load(w, block);
    float delta[1] = {};
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) {
      if (k >= block.count) continue;
      wi.v[k] = ri.v[k] - rhoi.v[k] * wi.v[k];
      delta[0] += di.v[k] * ri.v[k] * wi.v[k];
    }
    store(w, block, wi);
    write_partials(a, sums, block, delta, {sum_delta}, shared);
    if (block.index != 0) continue;

    float total[2];
    add_totals(a, sums, block.column, {sum_rr, sum_gamma}, total, shared);
    if (threadIdx.x != 0) continue;
    const bool open = total[0] > scalar(a, sums, slot_target, block.column);  // false for a NaN as well
    const float gamma = open ? total[1] : 0.0F;
    const float alpha = scalar(a, sums, slot_alpha, block.column);
    const bool restart = alpha == 0.0F;
    const float beta = restart ? 0.0F : quotient_or_zero(gamma, scalar(a, sums, slot_cg_gamma_old, block.column));
    scalar(a, sums, slot_cg_gamma, block.column) = gamma;
    scalar(a, sums, slot_cg_beta, block.column) = beta;
    scalar(a, sums, slot_cg_shift, block.column) = restart ? 0.0F : quotient_or_zero(beta * gamma, alpha);
  }
}

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    cg_step(const float* w, const float* d, float* r, float* p, float* s, float* x, float* sums,
            const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    float delta[1];
    add_totals(a, sums, block.column, {sum_delta}, delta, shared);
    const float gamma = scalar(a, sums, slot_cg_gamma, block.column);
    const float beta = scalar(a, sums, slot_cg_beta, block.column);
    const float curvature = delta[0] - scalar(a, sums, slot_cg_shift, block.column);  // (d p, A p)
    const float alpha = gamma > 0 && curvature > 0 ? quotient_or_zero(gamma, curvature) : 0.0F;
    if (block.index == 0 && threadIdx.x == 0) {
      scalar(a, sums, slot_alpha, block.column) = alpha;
      scalar(a, sums, slot_cg_gamma_old, block.column) = gamma;
    }
    Four ri = load(r, block);
    if (alpha != 0.0F) {
      const Four wi = load(w, block);
      Four pi = load(p, block), si = load(s, block), xi = load(x, block);
#pragma unroll
      for (unsigned k = 0; k < 4; ++k) {
        pi.v[k] = ri.v[k] + beta * pi.v[k];
        si.v[k] = wi.v[k] + beta * si.v[k];
        xi.v[k] += alpha * pi.v[k];
        ri.v[k] -= alpha * si.v[k];
      }
      store(p, block, pi);
      store(s, block, si);
      store(x, block, xi);
      store(r, block, ri);
    }
    const Four di = load(d, block);
    float part[2] = {};
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) {
      if (k >= block.count) continue;
      part[0] += ri.v[k] * ri.v[k];
      part[1] += di.v[k] * ri.v[k] * ri.v[k];
    }
    write_partials(a, sums, block, part, {sum_rr, sum_gamma}, shared);
  }
}
