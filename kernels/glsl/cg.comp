#ifdef KERNEL_cg_product
#define SUMS 4
#define TERMS 1
#else
#define SUMS 6
#define TERMS 2
#endif
#include "blocks.comp"

#ifdef KERNEL_cg_product

VECTOR(0, w)
INPUT(1, rho)
INPUT(2, d)
INPUT(3, r)

void element(uint i, inout float terms[TERMS]) {
  const float wi = r[i] - rho[i] * w[i];
  w[i] = wi;
  terms[0] += d[i] * r[i] * wi;
}

void write_scalars() {
  const bool open = total(sum_rr) > sums[scalar(slot_target)];
  const float gamma = open ? total(sum_gamma) : 0.0;
  const float alpha = sums[scalar(slot_alpha)];
  const float beta = alpha == 0.0 ? 0.0 : quotient_or_zero(gamma, sums[scalar(slot_cg_gamma_old)]);
  sums[scalar(slot_cg_gamma)] = gamma;
  sums[scalar(slot_cg_beta)] = beta;
  sums[scalar(slot_cg_shift)] = alpha == 0.0 ? 0.0 : quotient_or_zero(beta * gamma, alpha);
}

void main() {
  FOR_EACH_ITEM {
    float result[TERMS];
    block_sums(result);
    write_sum(sum_delta, result[0]);
    if (writes_column()) write_scalars();
  }
}

#else  // KERNEL_cg_step

INPUT(0, w)
INPUT(1, d)
VECTOR(2, r)
VECTOR(3, p)
VECTOR(4, s)
VECTOR(5, x)

float alpha;
float beta;

void element(uint i, inout float terms[TERMS]) {
  float ri = r[i];
  if (alpha != 0.0) {
    const float pi = ri + beta * p[i];
    const float si = w[i] + beta * s[i];
    p[i] = pi;
    s[i] = si;
    x[i] += alpha * pi;
    ri -= alpha * si;
    r[i] = ri;
  }
  terms[0] += ri * ri;
  terms[1] += d[i] * ri * ri;
}

void main() {
  FOR_EACH_ITEM {
    const float gamma = sums[scalar(slot_cg_gamma)];
    const float curvature = total(sum_delta) - sums[scalar(slot_cg_shift)];  // (d p, A p)
    beta = sums[scalar(slot_cg_beta)];
    alpha = gamma > 0.0 && curvature > 0.0 ? quotient_or_zero(gamma, curvature) : 0.0;
    float result[TERMS];
    block_sums(result);
    write_sum(sum_rr, result[0]);
    write_sum(sum_gamma, result[1]);
    if (writes_column()) {
      sums[scalar(slot_alpha)] = alpha;
      sums[scalar(slot_cg_gamma_old)] = gamma;
    }
  }
}

#endif
