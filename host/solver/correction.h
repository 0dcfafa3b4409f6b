#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "interflect/schedule/scheduler.h"
#include "interflect/solver/solver.h"

namespace interflect {

/// One single-precision solve on the devices: (I − diag(ρ) F) d = g with d = g + x, for all columns at once. The first
/// bounce, r = ρ∘(F g), is the residual of d = g, so that x starts at 0 and r and x vanish where ρ = 0.
/// The three methods differ in how they go on from there. All vectors exist before the first iteration; an iteration
/// enqueues its kernels and waits for nothing.
class Correction {
 public:
  Correction(const Correction&) = delete;
  Correction& operator=(const Correction&) = delete;
  virtual ~Correction() = default;

  /// Uploads the right-hand side g, sets x = 0, and enqueues the first bounce. A column is left as it is once (r, r) is
  /// not above its target.
  void begin(const Columns& g, std::span<const float> target);
  /// Enqueues one iteration.
  virtual void iterate() = 0;
  /// How many iterations begin() is worth: 1 for Jacobi, whose iteration is a bounce.
  [[nodiscard]] virtual std::uint32_t iterations_of_begin() const { return 0; }

  /// (r, r) of every column after what was enqueued, as the devices see it: the iteration's one synchronisation.
  [[nodiscard]] std::span<const float> residuals();
  /// Restarts after a breakdown, all columns together, up to the last residuals().
  [[nodiscard]] virtual std::uint32_t restarts() const { return 0; }
  /// x to the host.
  void solution(Columns& x) const { scheduler_.download(x_, x); }

 protected:
  Correction(Scheduler& scheduler, const Columns& reflectance, const Columns& weight);
  /// What begin() does after r = y = F g.
  virtual void first_step();
  [[nodiscard]] float slot(std::uint32_t slot, std::uint32_t column) const {
    return head_[slot * scheduler_.columns() + column];
  }

  Scheduler& scheduler_;
  VectorKernel bounce_;
  Vector rho_, weight_, r_, x_, y_, sums_;

 private:
  std::vector<float> head_;  ///< scalar slots and the partial sums of (r, r)
  std::vector<float> rr_;
};

/// The method's Correction. `weight` is d = A/ρ, 0 where ρ = 0 (CG's scalar product).
[[nodiscard]] std::unique_ptr<Correction> make_correction(Method method, Scheduler& scheduler,
                                                          const Columns& reflectance, const Columns& weight);
[[nodiscard]] std::unique_ptr<Correction> make_jacobi(Scheduler& scheduler, const Columns& reflectance,
                                                      const Columns& weight);
[[nodiscard]] std::unique_ptr<Correction> make_bicgstab(Scheduler& scheduler, const Columns& reflectance,
                                                        const Columns& weight);
[[nodiscard]] std::unique_ptr<Correction> make_cg(Scheduler& scheduler, const Columns& reflectance,
                                                  const Columns& weight);

}  // namespace interflect
