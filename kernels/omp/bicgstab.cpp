#include "omp/blocks.h"

namespace interflect::omp {

namespace {

// Scalar products of two vectors carry rounding of about 1e-7 times their lengths: below that they say nothing.
constexpr float noise_squared = 1e-13F;

}  // namespace

void bicgstab_product(const Launch& launch) {
  const Vectors v(launch);
  const float* x = v.floats(0);
  float* w = v.floats(1);
  const float* rho = v.floats(2);
  const float* z = v.floats(3);
  float* sums = v.floats(4);
  v.for_each_block([=, &v](const Block& block) {
    const auto terms = block_sums<5>(block, [=](std::uint64_t i, auto add) {
      w[i] = x[i] - rho[i] * w[i];
      add(0, x[i] * w[i]);
      add(1, w[i] * w[i]);
      add(2, z[i] * x[i]);
      add(3, z[i] * w[i]);
      add(4, x[i] * x[i]);
    });
    constexpr std::array sets{sum::xw, sum::ww, sum::zx, sum::zw, sum::xx};
    for (std::size_t s = 0; s < sets.size(); ++s) v.partial(sums, sets[s], block.column, block.index) = terms[s];
  });
}

void bicgstab_half(const Launch& launch) {
  const Vectors v(launch);
  const float* w = v.floats(0);
  float* r = v.floats(1);
  float* sums = v.floats(2);
  v.for_each_block([=, &v](const Block& block) {
    const auto scalar = [&](std::uint32_t slot) -> float& { return v.scalar(sums, slot, block.column); };
    const float rr = v.total(sums, sum::rr, block.column);
    const bool fresh = scalar(slot::bicgstab_rho) == 0.0F;  // after a restart z = r, so (z, r) = (z, z) = (r, r)
    const float rho = fresh ? rr : scalar(slot::bicgstab_rho);
    const float zz = fresh ? rr : scalar(slot::bicgstab_shadow);
    const float zv = v.total(sums, sum::zw, block.column);
    const float vv = v.total(sums, sum::ww, block.column);
    const bool open = rr > scalar(slot::target);
    const float alpha = open && zv * zv > noise_squared * zz * vv ? quotient_or_zero(rho, zv) : 0.0F;
    if (block.index == 0) {
      scalar(slot::alpha) = alpha;
      scalar(slot::bicgstab_rho_used) = rho;
      if (fresh) scalar(slot::bicgstab_shadow) = zz;
      if (open && alpha == 0.0F) scalar(slot::bicgstab_restarts) += 1.0F;
    }
    if (alpha == 0.0F) return;
#pragma omp simd
    for (std::uint64_t i = block.begin; i < block.end; ++i) r[i] -= alpha * w[i];
  });
}

namespace {

/// The scalars of a column's second half step.
struct HalfStep {
  float alpha = 0, omega = 0, beta = 0, rho = 0;
  bool restart = true;
};

HalfStep half_step(const Vectors& v, float* sums, std::uint32_t column) {
  const auto scalar = [&](std::uint32_t slot) { return v.scalar(sums, slot, column); };
  HalfStep h;
  h.alpha = scalar(slot::alpha);
  if (h.alpha == 0.0F) return h;
  const float ts = v.total(sums, sum::xw, column);
  const float tt = v.total(sums, sum::ww, column);
  h.omega = quotient_or_zero(ts, tt);
  h.rho = v.total(sums, sum::zx, column) - h.omega * v.total(sums, sum::zw, column);       // (z, s - ω t)
  const float rr = v.total(sums, sum::xx, column) - h.omega * (2.0F * ts - h.omega * tt);  // (s - ω t, s - ω t)
  const float zz = scalar(slot::bicgstab_shadow);
  h.beta = quotient_or_zero(h.rho * h.alpha, scalar(slot::bicgstab_rho_used) * h.omega);
  h.restart = h.beta == 0.0F || !(h.rho * h.rho > noise_squared * zz * rr);
  return h;
}

}  // namespace

void bicgstab_step(const Launch& launch) {
  const Vectors v(launch);
  const float* w = v.floats(0);
  const float* t = v.floats(1);
  float* z = v.floats(2);
  float* x = v.floats(3);
  float* r = v.floats(4);
  float* p = v.floats(5);
  float* sums = v.floats(6);
  v.for_each_block([=, &v](const Block& block) {
    const HalfStep h = half_step(v, sums, block.column);
    const float alpha = h.alpha, omega = h.omega, beta = h.beta;
    const auto step = [=](std::uint64_t i, auto add) {
      x[i] += alpha * p[i] + omega * r[i];
      r[i] -= omega * t[i];
      p[i] = r[i] + beta * (p[i] - omega * w[i]);
      add(0, r[i] * r[i]);
    };
    const auto step_and_restart = [=](std::uint64_t i, auto add) {
      if (alpha != 0.0F) {
        x[i] += alpha * p[i] + omega * r[i];
        r[i] -= omega * t[i];
      }
      p[i] = r[i];
      z[i] = r[i];
      add(0, r[i] * r[i]);
    };
    const auto [rr] = h.restart ? block_sums<1>(block, step_and_restart) : block_sums<1>(block, step);
    v.partial(sums, sum::rr, block.column, block.index) = rr;
    if (block.index != 0) return;
    v.scalar(sums, slot::bicgstab_rho, block.column) = h.restart ? 0.0F : h.rho;
    if (h.restart && alpha != 0.0F) v.scalar(sums, slot::bicgstab_restarts, block.column) += 1.0F;
  });
}

}  // namespace interflect::omp
