#pragma once

#include <optional>

#include "assembler.h"
#include "interflect/base/ranks.h"
#include "kept.h"
#include "pipeline.h"

// Where F is assembled and where it then lies.

namespace interflect::cli {

/// What several ranks did together, as rank 0 has seen it.
struct RanksReport {
  std::string transport;
  std::vector<std::string> devices;  ///< of each rank
  std::vector<std::uint32_t> rows;   ///< of F, of each rank
  RanksUse assembly, solve;          ///< with reading and writing of a file; with the final residuals
};

/// A solve from the mesh on.
struct PlacedSolve {
  FormFactors factors;  ///< without the matrix, where F has stayed on a device
  Solved solved;
  Energy energy;
  AssemblyUse assembly;
  Kept kept = {};
  std::optional<RanksReport> ranks = {};  ///< none: one process
};
/// What there is to write of it. The mesh is that of `loaded`, which must outlive the solution.
[[nodiscard]] Solution solution_of(const MeshedScene& loaded, const PlacedSolve& placed);
/// Assembles F and solves. In dense32 on a device that assembles, F stays there; a device that fails is followed by the
/// next candidate, which assembles F again in its own way and goes on from the last good iterate. A 16-bit format is
/// packed on the host: S then comes down from the device that made it. Warnings go to the progress sink. With light
/// groups in `lamps` all of them are columns of the same products, and Solved has their light one by one. Throws a
/// limit Error where --memory is less than F takes, wherever it is to lie.
[[nodiscard]] PlacedSolve assemble_and_solve(const MeshedScene& loaded, const SceneOptions& options,
                                             Assembler& assembler, std::optional<Storage> storage, Method method,
                                             const StopTest& stop, ProgressSink& progress, const Lamps& lamps = {});

/// The same with form factors that are kept in a file: form_factors_for_solve(). What exceeds the memory stays there.
[[nodiscard]] PlacedSolve solve_kept(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                                     Assembler& assembler, std::optional<Storage> storage, Method method,
                                     const StopTest& stop, ProgressSink& progress, const Lamps& lamps = {});

}  // namespace interflect::cli
