#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

enum class Method { cg, bicgstab, jacobi };
[[nodiscard]] std::string_view name(Method method);

/// When to stop: on the true relative residual ‖e − (I − diag(ρ)F) b‖₂ / ‖e‖₂ ≤ tolerance in every column.
struct StopTest {
  double tolerance = 1e-6;
  std::uint32_t max_iterations = 1000;
  std::optional<std::uint32_t> iterations = {};  ///< exactly so many (Jacobi: so many bounces)
};

/// What was solved, in counted (not estimated) figures.
struct SolveReport {
  bool converged = false;
  std::uint32_t iterations = 0;
  std::uint32_t products = 0;             ///< applications of F, the final residual's included
  std::vector<double> relative_residual;  ///< one per column, recomputed from b in double
  double seconds = 0;
  std::uint32_t passes = 0;    ///< single-precision solves; each after the first corrects the last one's residual
  std::uint32_t restarts = 0;  ///< BiCGSTAB's after a breakdown, all columns together
  std::string reason;          ///< one line saying why not, when not converged
};

/// Solves (I − diag(ρ) F) b = e for every column; reflectance, emittance and radiosity are C columns of N values, area
/// has N. `area` are the A_i that make diag(A) F symmetric (CG needs them). A column with e = 0 is solved (b = 0).
/// Patches with ρ = 0 are no unknowns of CG: b = e there, exactly.
///
/// Mixed precision: the devices solve (I − diag(ρ) F) d = r in fp32, the residual r of the fp32 result b is formed in
/// double, and b + d is corrected again for as long as that helps. So `converged` speaks of the b that is returned. A
/// tolerance below what an fp32 b can express ends as not converged, with the reason.
///
/// With stop.iterations = K exactly K iterations are done (Jacobi: b = Σ_{k<=K} (diag(ρ) F)^k e), `converged` then says
/// whether the residual happens to be within the tolerance.
///
/// Non-convergence is a result, not an exception; radiosity is finite even then. Throws a usage Error for shapes that
/// do not match or a tolerance that is negative or no number, an input Error for an emittance or area that is not
/// finite, an area that is not positive, or a reflectance outside [0, 1]; and what the devices throw.
[[nodiscard]] SolveReport solve(Scheduler& scheduler, Method method, const StopTest& stop, std::span<const double> area,
                                const Columns& reflectance, const Columns& emittance, Columns& radiosity,
                                ProgressSink* progress = nullptr);

}  // namespace interflect
