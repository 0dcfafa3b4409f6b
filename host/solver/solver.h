#pragma once

#include <array>
#include <cstdint>
#include <functional>
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
  double seconds = 0;                     ///< without what kernels took to compile or load (Scheduler::compile_seconds)
  std::uint32_t passes = 0;    ///< single-precision solves; each after the first corrects the last one's residual
  std::uint32_t restarts = 0;  ///< BiCGSTAB's after a breakdown, all columns together
  std::string reason;          ///< one line saying why not, when not converged; how far it came, when interrupted
  bool interrupted = false;    ///< ProgressSink::interrupted() ended it, after one iteration at least
};

/// Where a solve begins, and what it leaves when a device fails on the way: the last good iterate. As a starting guess,
/// b is the last solution of a problem that has changed a little since; it costs a product and saves one for about
/// every factor of four by which its residual is below ‖e‖. (An ambient term, Σ A e / Σ A (1 - ρ) in every patch, was
/// measured and left out: 10, 12 and 10 products for the rooms of 1,312, 3,360 and 9,680 patches, against 10, 11 and 11
/// without.)
struct Checkpoint {
  Columns b;                          ///< empty: nothing yet, the solve begins at 0
  std::uint32_t kept_iterations = 0;  ///< those that b is made of
  // Spent so far, what a failure has lost included.
  std::uint32_t iterations = 0, products = 0, passes = 0, restarts = 0;
  double seconds = 0;
  /// Seconds of iterating between two checkpoints within a pass: a download each, so that short solves pay nothing.
  double interval = 1.0;
  /// Called, if given, with each iterate that a failure would go on from, as soon as there is one, the iterations that
  /// it is made of, and what was spent until then (the checkpoint's figures included).
  std::function<void(const Columns& b, std::uint32_t made, const SolveReport& spent)> keep = {};
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
/// With a checkpoint the solve begins at its b, and adds to its figures: the report is of everything since the first
/// begin, and the limit of iterations counts those that b is made of. A column of b that is worse than 0 is dropped.
/// When a device Error is thrown, the checkpoint holds the last good iterate: the b that the last finished pass
/// accepted, or that of the last `interval`. Call solve() with it on another device, for the same problem.
///
/// Non-convergence is a result, not an exception; radiosity is finite even then. Throws a usage Error for shapes that
/// do not match or a tolerance that is negative or no number, an input Error for an emittance or area that is not
/// finite, an area that is not positive, or a reflectance outside [0, 1]; and what the devices throw.
[[nodiscard]] SolveReport solve(Scheduler& scheduler, Method method, const StopTest& stop, std::span<const double> area,
                                const Columns& reflectance, const Columns& emittance, Columns& radiosity,
                                ProgressSink* progress = nullptr, Checkpoint* checkpoint = nullptr);

}  // namespace interflect
