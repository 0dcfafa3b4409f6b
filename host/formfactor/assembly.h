#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/certificate.h"
#include "interflect/formfactor/closure.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/form_factor_rows.h"
#include "interflect/formfactor/pair_tile.h"
#include "interflect/formfactor/panel_store.h"
#include "interflect/formfactor/tile_maker.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

enum class Closure {
  automatic,  ///< on when the scene is closed
  on,
  off,
};

struct AssemblyOptions {
  Closure closure = Closure::automatic;
  std::uint64_t memory_limit = 0;  ///< bytes; 0: available_memory(). More than this predicted is a limit Error.
  std::uint64_t seed = 1;          ///< of the visibility samples; the result does not depend on the number of threads
  RayBudget budget = {};           ///< how accurate
  PanelStore* panels = nullptr;    ///< takes S panel by panel, and gives what it has
  /// Makes the tiles instead of Embree; null, or what it returns when it is: Embree. Patches and blockers live longer.
  std::function<std::unique_ptr<TileMaker>(const PatchTable& patches, const Blockers& blockers)> maker = {};
};

/// Row sums Σ_j F_ij over the patches that are not set aside.
struct RowSums {
  double min = 0, mean = 0, max = 0;
};

/// What the assembly did and how good it is.
struct AssemblyReport {
  bool closed_scene = false;   ///< escape_fraction is below 1e-4 (single rays slip through cracks of rounding)
  double escape_fraction = 0;  ///< share of cosine-distributed rays that left the scene, area-weighted over the patches
                               ///< that are not buried (a cupboard's back in the plane of the wall opens no room)
  double back_fraction = 0;    ///< share of them that ended on the back of a surface, area-weighted
  bool closure_applied = false;
  std::uint32_t closure_iterations = 0;
  double closure_max_change = 0;  ///< largest |d_i d_j − 1| by which a stored factor was moved
  RowSums before, after;
  /// Patches buried in other objects: row sum below 0.1 before the closure, or more than 0.9 of their hemisphere in
  /// backs. Left out of the closure (d = 1; what the others see of them counts towards the others' row sums). Empty
  /// where no closure was applied.
  std::vector<std::uint32_t> set_aside;
  std::vector<double> row_sum;         ///< after closure, one per patch
  std::vector<double> row_sum_before;  ///< as computed
  std::vector<double> scaling;         ///< d of the closure: F_ij = S_ij (d_i / A_i) d_j
  std::vector<float> tile_variance;    ///< TileFacts::variance of all tile rows
  std::uint32_t panels_reused = 0;     ///< that the store had
  Certificate certificate;             ///< the worst rows and why; not made where F came whole from elsewhere
  std::vector<std::string> warnings;
  std::uint64_t pairs_considered = 0;  ///< i < j that face each other, at least in part
  std::uint64_t pairs_analytic = 0;    ///< of them by the contour form
  std::uint64_t rays = 0;              ///< shadow rays traced
  double trace_seconds = 0;            ///< of `seconds` inside Embree, a thread's share; 0 elsewhere
  double seconds = 0;

  /// |row sum after / before − 1|: the mean |d_i d_j − 1| of the row's factors, by their size, where they move one way.
  [[nodiscard]] double row_change(std::size_t i) const;
  /// The rows that the closure moved by more than moved_much.
  [[nodiscard]] std::vector<std::uint32_t> moved() const;
};

struct FormFactors {
  FormFactorMatrix matrix;
  AssemblyReport report;
};

/// Computes the exchange area S_ij = A_i F_ij once per pair i < j, in single precision, so that S is symmetric to the
/// bit; then F_ij = S_ij (d_i / A_i) d_j:
///   S_ij = ∫_Ai ∫_Aj V(x, y) cosθ_x cosθ_y / (π |x − y|²) dy dx
/// Near pairs by the contour form, far pairs by quadrature, V by shadow rays. With closure d makes every row sum 1
/// within 1e-4.
/// Throws a limit Error, before any work, when the memory will not do, and what maker and panels throw.
[[nodiscard]] FormFactors assemble(const PatchMesh& mesh, const AssemblyOptions& options = {},
                                   ProgressSink* progress = nullptr);

/// The bytes that assemble() takes for so many patches, on the threads that OpenMP has.
[[nodiscard]] std::uint64_t assembly_memory(std::uint64_t patches);

/// The same for a matrix that need not fit the memory: S lies in the store alone, d in the report's scaling (see
/// StreamedMatrix). `memory` bytes are for rows of S; options.memory_limit is for everything. Panels and report are the
/// same to the bit as with assemble() and that store; F is not made. Throws a limit Error where two panels of the store
/// do not fit.
[[nodiscard]] AssemblyReport assemble_into(PanelStore& panels, const PatchMesh& mesh, const AssemblyOptions& options,
                                           std::uint64_t memory, ProgressSink* progress = nullptr);

/// What follows once S is known, wherever it lies: judges whether the scene is closed, finds d, and reports. The caller
/// makes F of S and d, and then calls note_change(). `report` has the facts of the tiles already.
[[nodiscard]] Scaling judge(const PatchMesh& mesh, const PatchTable& patches, const Blockers& blockers,
                            const AssemblyOptions& options, const ExchangeProduct& product, AssemblyReport& report);
/// Notes how far the scaling moved the factors, when Scaling::max_change is known, and warns above moved_much.
void note_change(const PatchMesh& mesh, const Scaling& scaling, AssemblyReport& report);

/// F between groups of patches: factors[a][b] = Σ_{i∈a} Σ_{j∈b} A_i F_ij / Σ_{i∈a} A_i. Groups of obstructions have no
/// row and no column.
struct GroupFactors {
  std::vector<std::string> groups;
  std::vector<double> areas;
  std::vector<std::vector<double>> factors;
  std::vector<double> sky;                 ///< per group: what goes to no patch at all, 1 − Σ_j F_ij, at least 0
  std::vector<std::string> left_out = {};  ///< the groups of obstructions
};
[[nodiscard]] GroupFactors between(const FormFactorRows& f, const std::vector<double>& area,
                                   const std::vector<std::uint32_t>& surface, const Grouping& grouping);
[[nodiscard]] GroupFactors between(const FormFactorMatrix& f, const PatchMesh& mesh, const Grouping& grouping);

}  // namespace interflect
