#include "interflect/solver/correction.h"

namespace interflect {

namespace {

/// BiCGSTAB (van der Vorst, 1992) on A := I − diag(ρ)F, with z the shadow residual and s kept in r's place:
///   v = A p;  α = ϱ/(z, v);  s = r − α v;  t = A s;  ω = (t, s)/(t, t);  x += α p + ω s;  r = s − ω t;
///   ϱ' = (z, s) − ω (z, t);  β = ϱ'/ϱ α/ω;  p = r + β (p − ω v)
/// When a scalar product that is divided by is lost in rounding, the column restarts: z = p = r.
///
/// Memory traffic of an iteration, in column values: F twice; 15 reads, 6 writes.
class BiCgStab final : public Correction {
 public:
  BiCgStab(Scheduler& scheduler, const Columns& reflectance, const Columns& weight)
      : Correction(scheduler, reflectance, weight),
        product_(scheduler.kernel("bicgstab_product")),
        half_(scheduler.kernel("bicgstab_half")),
        step_(scheduler.kernel("bicgstab_step")),
        p_(scheduler.vector()),
        t_(scheduler.vector()),
        z_(scheduler.vector()) {}

  void iterate() override {
    // y = F * p
    scheduler_.apply(p_, y_);
    // v = p - rho * y (in y);  (z, v), (v, v)                       reads p, y, rho, z; writes v
    scheduler_.run(product_, {&p_, &y_, &rho_, &z_, &sums_}, "BiCGSTAB v");
    // alpha;  r -= alpha * v (now s)                                reads v, r; writes r
    scheduler_.run(half_, {&y_, &r_, &sums_}, "BiCGSTAB s");
    // t = F * s
    scheduler_.apply(r_, t_);
    // t = s - rho * t;  (s, t), (t, t), (z, s), (z, t), (s, s)      reads s, t, rho, z; writes t
    scheduler_.run(product_, {&r_, &t_, &rho_, &z_, &sums_}, "BiCGSTAB t");
    // omega, beta;  x += alpha * p + omega * s;  r = s - omega * t;  p = r + beta * (p - omega * v);  (r, r)
    //                                                               reads v, t, x, r, p (z); writes x, r, p (z)
    scheduler_.run(step_, {&y_, &t_, &z_, &x_, &r_, &p_, &sums_}, "BiCGSTAB step");
  }

  [[nodiscard]] std::uint32_t restarts() const override {
    float count = 0;
    for (std::uint32_t c = 0; c < scheduler_.columns(); ++c) count += slot(slot::bicgstab_restarts, c);
    return static_cast<std::uint32_t>(count);
  }

 private:
  void first_step() override {
    Correction::first_step();
    // alpha = 0 so far: z = p = r
    scheduler_.run(step_, {&y_, &t_, &z_, &x_, &r_, &p_, &sums_}, "BiCGSTAB start");
  }

  VectorKernel product_, half_, step_;
  Vector p_, t_, z_;
};

}  // namespace

std::unique_ptr<Correction> make_bicgstab(Scheduler& scheduler, const Columns& reflectance, const Columns& weight) {
  return std::make_unique<BiCgStab>(scheduler, reflectance, weight);
}

}  // namespace interflect
