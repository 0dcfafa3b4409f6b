#include "blocks.cl"

/// The scalars of the next step, from those of the last and the sums before this launch.
void cg_scalars(global float* sums, const VectorArguments a, uint column) {
  const bool open = total(a, sums, sum_rr, column) > sums[scalar_at(a, slot_target, column)];  // false for a NaN as well
  const float gamma = open ? total(a, sums, sum_gamma, column) : 0.0f;
  const float alpha = sums[scalar_at(a, slot_alpha, column)];
  const bool restart = alpha == 0.0f;
  const float beta = restart ? 0.0f : quotient_or_zero(gamma, sums[scalar_at(a, cg_gamma_old, column)]);
  sums[scalar_at(a, cg_gamma, column)] = gamma;
  sums[scalar_at(a, cg_beta, column)] = beta;
  sums[scalar_at(a, cg_shift, column)] = restart ? 0.0f : quotient_or_zero(beta * gamma, alpha);
}

kernel GROUP_OF_ITEMS void interflect_cg_product(global float* w, global const float* rho, global const float* d,
                                      global const float* r, global float* sums, const VectorArguments a) {
  SCRATCH(1);
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    lanes sum[1] = {0};
    FOR_EACH_ELEMENT(i, b) {
      const lanes ri = load(r, i, b.end);
      const lanes wi = ri - load(rho, i, b.end) * load(w, i, b.end);
      store(wi, w, i, b.end);
      sum[0] += load(d, i, b.end) * ri * wi;
    }
    float delta[1];
    join(sum, 1, scratch, delta);
    if (get_local_id(0) == 0) {
      sums[partial_at(a, sum_delta, b.column, b.index)] = delta[0];
      if (b.index == 0) cg_scalars(sums, a, b.column);
    }
  }
}

kernel GROUP_OF_ITEMS void interflect_cg_step(global const float* w, global const float* d, global float* r, global float* p,
                                   global float* s, global float* x, global float* sums, const VectorArguments a) {
  SCRATCH(2);
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    const float gamma = sums[scalar_at(a, cg_gamma, b.column)];
    const float beta = sums[scalar_at(a, cg_beta, b.column)];
    const float curvature = total(a, sums, sum_delta, b.column) - sums[scalar_at(a, cg_shift, b.column)];  // (d p, A p)
    const float alpha = gamma > 0 && curvature > 0 ? quotient_or_zero(gamma, curvature) : 0.0f;
    lanes sum[2] = {0, 0};
    FOR_EACH_ELEMENT(i, b) {
      lanes ri = load(r, i, b.end);
      if (alpha != 0.0f) {
        const lanes pi = ri + beta * load(p, i, b.end);
        const lanes si = load(w, i, b.end) + beta * load(s, i, b.end);
        ri -= alpha * si;
        store(pi, p, i, b.end);
        store(si, s, i, b.end);
        store(load(x, i, b.end) + alpha * pi, x, i, b.end);
        store(ri, r, i, b.end);
      }
      sum[0] += ri * ri;
      sum[1] += load(d, i, b.end) * ri * ri;
    }
    float joined[2];
    join(sum, 2, scratch, joined);
    if (get_local_id(0) == 0) {
      sums[partial_at(a, sum_rr, b.column, b.index)] = joined[0];
      sums[partial_at(a, sum_gamma, b.column, b.index)] = joined[1];
      if (b.index == 0) {
        sums[scalar_at(a, slot_alpha, b.column)] = alpha;
        sums[scalar_at(a, cg_gamma_old, b.column)] = gamma;
      }
    }
  }
}
