#include "interflect/solver/correction.h"

namespace interflect {

namespace {

/// b ← e + ρ∘(F b), written by its residual: b_{k+1} = b_k + r_k and r_{k+1} = ρ∘(F r_k), since
/// e − (I − diag(ρ)F)(b_k + r_k) = ρ∘(F r_k). So the residual of the newest b comes with it, without cancellation and
/// without a product of its own.
///
/// Memory traffic of an iteration, in column values: F once; 4 reads, 2 writes.
class Jacobi final : public Correction {
 public:
  Jacobi(Scheduler& scheduler, const Columns& reflectance, const Columns& weight)
      : Correction(scheduler, reflectance, weight) {}

  void iterate() override {
    scheduler_.apply(r_, y_);  // y = F * r
    first_step();
  }
  [[nodiscard]] std::uint32_t iterations_of_begin() const override { return 1; }

 private:
  void first_step() override {
    // r = rho * y;  x += r;  (r, r)                                 reads y, rho, d, x; writes r, x
    scheduler_.run(bounce_, {&y_, &rho_, &weight_, &r_, &x_, &sums_}, "Jacobi bounce", 1);
  }
};

}  // namespace

std::unique_ptr<Correction> make_jacobi(Scheduler& scheduler, const Columns& reflectance, const Columns& weight) {
  return std::make_unique<Jacobi>(scheduler, reflectance, weight);
}

}  // namespace interflect
