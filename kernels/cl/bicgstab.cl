#include "blocks.cl"

// Scalar products of two vectors carry rounding of about 1e-7 times their lengths: below that they say nothing.
#define NOISE_SQUARED 1e-13f

kernel GROUP_OF_ITEMS void interflect_bicgstab_product(global const float* x, global float* w, global const float* rho,
                                            global const float* z, global float* sums, const VectorArguments a) {
  SCRATCH(5);
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    lanes sum[5] = {0, 0, 0, 0, 0};
    FOR_EACH_ELEMENT(i, b) {
      const lanes xi = load(x, i, b.end);
      const lanes zi = load(z, i, b.end);
      const lanes wi = xi - load(rho, i, b.end) * load(w, i, b.end);
      store(wi, w, i, b.end);
      sum[0] += xi * wi;
      sum[1] += wi * wi;
      sum[2] += zi * xi;
      sum[3] += zi * wi;
      sum[4] += xi * xi;
    }
    float joined[5];
    join(sum, 5, scratch, joined);
    if (get_local_id(0) == 0) {
      for (uint s = 0; s < 5; ++s) sums[partial_at(a, sum_xw + s, b.column, b.index)] = joined[s];
    }
  }
}

kernel GROUP_OF_ITEMS void interflect_bicgstab_half(global const float* w, global float* r, global float* sums,
                                         const VectorArguments a) {
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    const float rr = total(a, sums, sum_rr, b.column);
    const bool fresh = sums[scalar_at(a, bicgstab_rho, b.column)] == 0.0f;  // after a restart z = r: (z, r) = (r, r)
    const float rho = fresh ? rr : sums[scalar_at(a, bicgstab_rho, b.column)];
    const float zz = fresh ? rr : sums[scalar_at(a, bicgstab_shadow, b.column)];
    const float zv = total(a, sums, sum_zw, b.column);
    const float vv = total(a, sums, sum_ww, b.column);
    const bool open = rr > sums[scalar_at(a, slot_target, b.column)];
    const float alpha = open && zv * zv > NOISE_SQUARED * zz * vv ? quotient_or_zero(rho, zv) : 0.0f;
    if (b.index == 0 && get_local_id(0) == 0) {
      sums[scalar_at(a, slot_alpha, b.column)] = alpha;
      sums[scalar_at(a, bicgstab_rho_used, b.column)] = rho;
      if (fresh) sums[scalar_at(a, bicgstab_shadow, b.column)] = zz;
      if (open && alpha == 0.0f) sums[scalar_at(a, bicgstab_restarts, b.column)] += 1.0f;
    }
    if (alpha == 0.0f) continue;
    FOR_EACH_ELEMENT(i, b) store(load(r, i, b.end) - alpha * load(w, i, b.end), r, i, b.end);
  }
}

/// The scalars of a column's second half step.
typedef struct {
  float alpha, omega, beta, rho;
  bool restart;
} HalfStep;

HalfStep half_step(global const float* sums, const VectorArguments a, uint column) {
  HalfStep h = {sums[scalar_at(a, slot_alpha, column)], 0.0f, 0.0f, 0.0f, true};
  if (h.alpha == 0.0f) return h;
  const float ts = total(a, sums, sum_xw, column);
  const float tt = total(a, sums, sum_ww, column);
  h.omega = quotient_or_zero(ts, tt);
  h.rho = total(a, sums, sum_zx, column) - h.omega * total(a, sums, sum_zw, column);       // (z, s - ω t)
  const float rr = total(a, sums, sum_xx, column) - h.omega * (2.0f * ts - h.omega * tt);  // (s - ω t, s - ω t)
  const float zz = sums[scalar_at(a, bicgstab_shadow, column)];
  h.beta = quotient_or_zero(h.rho * h.alpha, sums[scalar_at(a, bicgstab_rho_used, column)] * h.omega);
  h.restart = h.beta == 0.0f || !(h.rho * h.rho > NOISE_SQUARED * zz * rr);
  return h;
}

kernel GROUP_OF_ITEMS void interflect_bicgstab_step(global const float* w, global const float* t, global float* z, global float* x,
                                         global float* r, global float* p, global float* sums,
                                         const VectorArguments a) {
  SCRATCH(1);
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    const HalfStep h = half_step(sums, a, b.column);
    lanes sum[1] = {0};
    FOR_EACH_ELEMENT(i, b) {
      lanes ri = load(r, i, b.end);
      const lanes pi = load(p, i, b.end);
      if (h.alpha != 0.0f) {
        store(load(x, i, b.end) + h.alpha * pi + h.omega * ri, x, i, b.end);
        ri -= h.omega * load(t, i, b.end);
        store(ri, r, i, b.end);
      }
      if (h.restart) {
        store(ri, p, i, b.end);
        store(ri, z, i, b.end);
      } else {
        store(ri + h.beta * (pi - h.omega * load(w, i, b.end)), p, i, b.end);
      }
      sum[0] += ri * ri;
    }
    float rr[1];
    join(sum, 1, scratch, rr);
    if (get_local_id(0) == 0) {
      sums[partial_at(a, sum_rr, b.column, b.index)] = rr[0];
      if (b.index == 0) {
        sums[scalar_at(a, bicgstab_rho, b.column)] = h.restart ? 0.0f : h.rho;
        if (h.restart && h.alpha != 0.0f) sums[scalar_at(a, bicgstab_restarts, b.column)] += 1.0f;
      }
    }
  }
}
