#if defined(KERNEL_bicgstab_product)
#define SUMS 4
#define TERMS 5
#elif defined(KERNEL_bicgstab_half)
#define SUMS 2
#else
#define SUMS 6
#define TERMS 1
#endif
#include "blocks.comp"

// Scalar products of two vectors carry rounding of about 1e-7 times their lengths: below that they say nothing.
const float noise_squared = 1e-13;

#if defined(KERNEL_bicgstab_product)

INPUT(0, x)
VECTOR(1, w)
INPUT(2, rho)
INPUT(3, z)

void element(uint i, inout float terms[TERMS]) {
  const float xi = x[i];
  const float zi = z[i];
  const float wi = xi - rho[i] * w[i];
  w[i] = wi;
  terms[0] += xi * wi;
  terms[1] += wi * wi;
  terms[2] += zi * xi;
  terms[3] += zi * wi;
  terms[4] += xi * xi;
}

void main() {
  FOR_EACH_ITEM {
    float result[TERMS];
    block_sums(result);
    write_sum(sum_xw, result[0]);
    write_sum(sum_ww, result[1]);
    write_sum(sum_zx, result[2]);
    write_sum(sum_zw, result[3]);
    write_sum(sum_xx, result[4]);
  }
}

#elif defined(KERNEL_bicgstab_half)

INPUT(0, w)
VECTOR(1, r)

void main() {
  FOR_EACH_ITEM {
    const float rr = total(sum_rr);
    const float carried = sums[scalar(slot_bicgstab_rho)];
    const bool fresh = carried == 0.0;  // after a restart z = r, so (z, r) = (z, z) = (r, r)
    const float rho = fresh ? rr : carried;
    const float zz = fresh ? rr : sums[scalar(slot_bicgstab_shadow)];
    const float zv = total(sum_zw);
    const float vv = total(sum_ww);
    const bool open = rr > sums[scalar(slot_target)];
    const float alpha = open && zv * zv > noise_squared * zz * vv ? quotient_or_zero(rho, zv) : 0.0;
    if (writes_column()) {
      sums[scalar(slot_alpha)] = alpha;
      sums[scalar(slot_bicgstab_rho_used)] = rho;
      if (fresh) sums[scalar(slot_bicgstab_shadow)] = zz;
      if (open && alpha == 0.0) sums[scalar(slot_bicgstab_restarts)] += 1.0;
    }
    if (alpha != 0.0) {
      FOR_EACH_ELEMENT(i) r[i] -= alpha * w[i];
    }
  }
}

#else  // KERNEL_bicgstab_step

INPUT(0, w)
INPUT(1, t)
VECTOR(2, z)
VECTOR(3, x)
VECTOR(4, r)
VECTOR(5, p)

// The scalars of the column's second half step.
float alpha;
float omega;
float beta;
float rho;
bool restart;

void take_scalars() {
  alpha = sums[scalar(slot_alpha)];
  omega = 0.0;
  beta = 0.0;
  rho = 0.0;
  restart = true;
  if (alpha == 0.0) return;
  const float ts = total(sum_xw);
  const float tt = total(sum_ww);
  omega = quotient_or_zero(ts, tt);
  rho = total(sum_zx) - omega * total(sum_zw);                              // (z, s - ω t)
  const float rr = total(sum_xx) - omega * (2.0 * ts - omega * tt);         // (s - ω t, s - ω t)
  beta = quotient_or_zero(rho * alpha, sums[scalar(slot_bicgstab_rho_used)] * omega);
  const bool sound = rho * rho > noise_squared * sums[scalar(slot_bicgstab_shadow)] * rr;
  restart = beta == 0.0 || !sound;
}

void element(uint i, inout float terms[TERMS]) {
  float ri = r[i];
  const float pi = p[i];
  if (alpha != 0.0) {
    x[i] += alpha * pi + omega * ri;
    ri -= omega * t[i];
    r[i] = ri;
  }
  if (restart) {
    p[i] = ri;
    z[i] = ri;
  } else {
    p[i] = ri + beta * (pi - omega * w[i]);
  }
  terms[0] += ri * ri;
}

void main() {
  FOR_EACH_ITEM {
    take_scalars();
    float result[TERMS];
    block_sums(result);
    write_sum(sum_rr, result[0]);
    if (writes_column()) {
      sums[scalar(slot_bicgstab_rho)] = restart ? 0.0 : rho;
      if (restart && alpha != 0.0) sums[scalar(slot_bicgstab_restarts)] += 1.0;
    }
  }
}

#endif
