#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
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
  std::optional<std::uint32_t> iterations;  ///< exactly so many, whatever the residual (Jacobi: so many bounces)
};

/// What was solved, in counted (not estimated) figures.
struct SolveReport {
  bool converged = false;
  std::uint32_t iterations = 0;
  std::uint32_t products = 0;             ///< applications of F, the final residual's included
  std::vector<double> relative_residual;  ///< one per column, recomputed from b in double
  double seconds = 0;
};

/// Columns of N values, one column per channel (and light group), each contiguous.
using Columns = std::vector<std::vector<float>>;

/// Solves (I − diag(ρ) F) b = e for every column. `area` are the A_i that make diag(A) F symmetric (CG needs them).
/// A column with e = 0 is solved (b = 0). Patches with ρ = 0 are no unknowns of CG: b = e there.
/// Non-convergence is a result, not an exception. Throws what the devices throw.
[[nodiscard]] SolveReport solve(Scheduler& scheduler, Method method, const StopTest& stop, std::span<const double> area,
                                const Columns& reflectance, const Columns& emittance, Columns& radiosity,
                                ProgressSink* progress = nullptr);

}  // namespace interflect
