#include "blocks.cuh"

// Contracts: kernels/README.md.

// Scalar products of two vectors carry rounding of about 1e-7 times their lengths: below that they say nothing.
constexpr float noise_squared = 1e-13F;

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    bicgstab_product(const float* x, float* w, const float* rho, const float* z, float* sums, const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const Four xi = load(x, block), rhoi = load(rho, block), zi = load(z, block);
    Four wi = load(w, block);
    float part[5] = {};
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) {
      if (k >= block.count) continue;
      wi.v[k] = xi.v[k] - rhoi.v[k] * wi.v[k];
      part[0] += xi.v[k] * wi.v[k];
      part[1] += wi.v[k] * wi.v[k];
      part[2] += zi.v[k] * xi.v[k];
      part[3] += zi.v[k] * wi.v[k];
      part[4] += xi.v[k] * xi.v[k];
    }
    store(w, block, wi);
    write_partials(a, sums, block, part, {sum_xw, sum_ww, sum_zx, sum_zw, sum_xx}, shared);
  }
}

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    bicgstab_half(const float* v, float* r, float* sums, const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    float total[3];
    add_totals(a, sums, block.column, {sum_rr, sum_zw, sum_ww}, total, shared);
    const float rr = total[0], zv = total[1], vv = total[2];
    const float rho_before = scalar(a, sums, slot_bicgstab_rho, block.column);
    const bool fresh = rho_before == 0.0F;  // after a restart z = r, so (z, r) = (z, z) = (r, r)
    const float rho = fresh ? rr : rho_before;
    const float zz = fresh ? rr : scalar(a, sums, slot_bicgstab_shadow, block.column);
    const bool open = rr > scalar(a, sums, slot_target, block.column);
    const float alpha = open && zv * zv > noise_squared * zz * vv ? quotient_or_zero(rho, zv) : 0.0F;
    if (block.index == 0 && threadIdx.x == 0) {
      scalar(a, sums, slot_alpha, block.column) = alpha;
      scalar(a, sums, slot_bicgstab_rho_used, block.column) = rho;
      if (fresh) scalar(a, sums, slot_bicgstab_shadow, block.column) = zz;
      if (open && alpha == 0.0F) scalar(a, sums, slot_bicgstab_restarts, block.column) += 1.0F;
    }
    if (alpha == 0.0F) continue;
    const Four vi = load(v, block);
    Four ri = load(r, block);
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) ri.v[k] -= alpha * vi.v[k];
    store(r, block, ri);
  }
}

/// The scalars of a column's second half step.
struct HalfStep {
  float alpha, omega, beta, rho;
  bool restart;
};

__device__ HalfStep half_step(const VectorArguments& a, float* sums, unsigned column, Shared& shared) {
  float total[5];
  add_totals(a, sums, column, {sum_xw, sum_ww, sum_zx, sum_zw, sum_xx}, total, shared);
  HalfStep h = {scalar(a, sums, slot_alpha, column), 0, 0, 0, true};
  if (h.alpha == 0.0F) return h;
  const float ts = total[0], tt = total[1];
  h.omega = quotient_or_zero(ts, tt);
  h.rho = total[2] - h.omega * total[3];                             // (z, s - ω t)
  const float rr = total[4] - h.omega * (2.0F * ts - h.omega * tt);  // (s - ω t, s - ω t)
  const float zz = scalar(a, sums, slot_bicgstab_shadow, column);
  h.beta = quotient_or_zero(h.rho * h.alpha, scalar(a, sums, slot_bicgstab_rho_used, column) * h.omega);
  h.restart = h.beta == 0.0F || !(h.rho * h.rho > noise_squared * zz * rr);
  return h;
}

extern "C" __global__ void __launch_bounds__(WORKGROUP)
    bicgstab_step(const float* v, const float* t, float* z, float* x, float* r, float* p, float* sums,
                  const VectorArguments a) {
  __shared__ Shared shared;
  for (Index item = first_item(a); item < last_item(a); ++item) {
    const Block block = block_of(a, item);
    const HalfStep h = half_step(a, sums, block.column, shared);
    Four ri = load(r, block), pi = load(p, block);
    if (h.alpha != 0.0F) {
      const Four ti = load(t, block);
      Four xi = load(x, block);
#pragma unroll
      for (unsigned k = 0; k < 4; ++k) {
        xi.v[k] += h.alpha * pi.v[k] + h.omega * ri.v[k];
        ri.v[k] -= h.omega * ti.v[k];
      }
      store(x, block, xi);
      store(r, block, ri);
    }
    if (h.restart) {
      pi = ri;
      store(z, block, ri);
    } else {
      const Four vi = load(v, block);
#pragma unroll
      for (unsigned k = 0; k < 4; ++k) pi.v[k] = ri.v[k] + h.beta * (pi.v[k] - h.omega * vi.v[k]);
    }
    store(p, block, pi);
    float rr[1] = {};
#pragma unroll
    for (unsigned k = 0; k < 4; ++k) {
      if (k < block.count) rr[0] += ri.v[k] * ri.v[k];
    }
    write_partials(a, sums, block, rr, {sum_rr}, shared);
    if (block.index != 0 || threadIdx.x != 0) continue;
    scalar(a, sums, slot_bicgstab_rho, block.column) = h.restart ? 0.0F : h.rho;
    if (h.restart && h.alpha != 0.0F) scalar(a, sums, slot_bicgstab_restarts, block.column) += 1.0F;
  }
}
