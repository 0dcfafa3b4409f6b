#include "interflect/solver/correction.h"

namespace interflect {

namespace {

/// Conjugate gradients on (I − D^-½ S D^-½) u = D^½ e with u = D^½ b, D = diag(A/ρ), S = diag(A) F, written in b: the
/// operator A := I − diag(ρ)F is self-adjoint in the scalar product (x, D y), and CG's preconditioned residual in b is
/// the true one, r = e − A b. So only the scalar products carry D; the stop test gets (r, r) for the price of an
/// addition. Where ρ = 0 the weight is 0 and r, p, x stay 0: b = e there.
///
/// In the form of Chronopoulos and Gear (s-step iterative methods, 1989), whose s = A p is carried along instead of
/// computed, so that one sum per iteration is waited for before one fused update:
///   w = A r;  γ = (r, D r);  δ = (r, D w);  β = γ/γ';  α = γ/(δ − β γ/α');  p = r + β p;  s = w + β s;
///   x += α p;  r −= α s
/// A column whose denominator is not positive keeps α = 0 and begins anew with β = 0 from its residual.
///
/// Memory traffic of an iteration, in column values: F once; 10 reads, 5 writes.
class ConjugateGradients final : public Correction {
 public:
  ConjugateGradients(Scheduler& scheduler, const Columns& reflectance, const Columns& weight)
      : Correction(scheduler, reflectance, weight),
        product_(scheduler.kernel("cg_product")),
        step_(scheduler.kernel("cg_step")),
        p_(scheduler.vector()),
        s_(scheduler.vector()) {}

  void iterate() override {
    // y = F * r
    scheduler_.apply(r_, y_);
    // w = r - rho * y (in y);  delta = (d * r, w);  beta, shift     reads y, rho, d, r; writes w
    scheduler_.run(product_, {&y_, &rho_, &weight_, &r_, &sums_}, "CG product");
    // alpha;  p = r + beta * p;  s = w + beta * s;  x += alpha * p;  r -= alpha * s;  (r, r);  gamma = (d * r, r)
    //                                                               reads w, d, r, p, s, x; writes r, p, s, x
    scheduler_.run(step_, {&y_, &weight_, &r_, &p_, &s_, &x_, &sums_}, "CG step");
  }

 private:
  VectorKernel product_, step_;
  Vector p_, s_;
};

}  // namespace

std::unique_ptr<Correction> make_cg(Scheduler& scheduler, const Columns& reflectance, const Columns& weight) {
  return std::make_unique<ConjugateGradients>(scheduler, reflectance, weight);
}

}  // namespace interflect
