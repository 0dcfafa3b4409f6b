#pragma once

#include <cstdint>

#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/solver/solver.h"

namespace interflect::cli {

/// How the plain loop keeps its vectors: an array of structures (red, green, blue of a patch side by side, as the study
/// of 2014 had it), or a structure of arrays.
enum class VectorLayout { aos, soa };

struct LoopReport {
  std::uint32_t iterations = 0;  ///< products with F
  bool converged = false;
  double seconds = 0;  ///< of the iterations; vectors are made before
};

/// Jacobi as the study of 2014 did it: b <- e + ρ∘(F b) from b = e by the loop that its formula says, all in fp32, one
/// `omp parallel for` over the rows when `parallel`; until ‖e − (I − diag(ρ)F) b‖₂ / ‖e‖₂ <= stop.tolerance in every
/// channel, which is the last change of b, or stop.max_iterations. It is what our kernels are compared with: built with
/// the same flags, not tuned. Reflectance and emittance are 3 columns of N; radiosity becomes that. Throws an internal
/// Error for another shape.
[[nodiscard]] LoopReport plain_jacobi(const FormFactorMatrix& f, const Columns& reflectance, const Columns& emittance,
                                      VectorLayout layout, bool parallel, const StopTest& stop, Columns& radiosity);

}  // namespace interflect::cli
