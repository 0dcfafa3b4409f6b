#include "omp/blocks.h"

namespace interflect::omp {

void cg_product(const Launch& launch) {
  const Vectors v(launch);
  float* w = v.floats(0);
  const float* rho = v.floats(1);
  const float* d = v.floats(2);
  const float* r = v.floats(3);
  float* sums = v.floats(4);
  v.for_each_block([=, &v](const Block& block) {
    const auto [delta] = block_sums<1>(block, [=](std::uint64_t i, auto add) {
      w[i] = r[i] - rho[i] * w[i];
      add(0, d[i] * r[i] * w[i]);
    });
    v.partial(sums, sum::delta, block.column, block.index) = delta;
    if (block.index != 0) return;

    const auto scalar = [&](std::uint32_t slot) -> float& { return v.scalar(sums, slot, block.column); };
    const bool open = v.total(sums, sum::rr, block.column) > scalar(slot::target);  // false for a NaN as well
    const float gamma = open ? v.total(sums, sum::gamma, block.column) : 0.0F;
    const bool restart = scalar(slot::alpha) == 0.0F;
    const float beta = restart ? 0.0F : quotient_or_zero(gamma, scalar(slot::cg_gamma_old));
    scalar(slot::cg_gamma) = gamma;
    scalar(slot::cg_beta) = beta;
    scalar(slot::cg_shift) = restart ? 0.0F : quotient_or_zero(beta * gamma, scalar(slot::alpha));
  });
}

void cg_step(const Launch& launch) {
  const Vectors v(launch);
  const float* w = v.floats(0);
  const float* d = v.floats(1);
  float* r = v.floats(2);
  float* p = v.floats(3);
  float* s = v.floats(4);
  float* x = v.floats(5);
  float* sums = v.floats(6);
  v.for_each_block([=, &v](const Block& block) {
    const auto scalar = [&](std::uint32_t slot) -> float& { return v.scalar(sums, slot, block.column); };
    const float gamma = scalar(slot::cg_gamma);
    const float beta = scalar(slot::cg_beta);
    const float curvature = v.total(sums, sum::delta, block.column) - scalar(slot::cg_shift);  // (d p, A p)
    const float alpha = gamma > 0 && curvature > 0 ? quotient_or_zero(gamma, curvature) : 0.0F;
    if (block.index == 0) {
      scalar(slot::alpha) = alpha;
      scalar(slot::cg_gamma_old) = gamma;
    }
    const auto residual = [=](std::uint64_t i, auto add) {
      add(0, r[i] * r[i]);
      add(1, d[i] * r[i] * r[i]);
    };
    const auto step = [=](std::uint64_t i, auto add) {
      p[i] = r[i] + beta * p[i];
      s[i] = w[i] + beta * s[i];
      x[i] += alpha * p[i];
      r[i] -= alpha * s[i];
      residual(i, add);
    };
    const auto [rr, rdr] = alpha == 0.0F ? block_sums<2>(block, residual) : block_sums<2>(block, step);
    v.partial(sums, sum::rr, block.column, block.index) = rr;
    v.partial(sums, sum::gamma, block.column, block.index) = rdr;
  });
}

}  // namespace interflect::omp
