#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "interflect/solver/solver.h"
#include "pipeline.h"
#include "place.h"

namespace interflect::cli {

/// What the command line says of how to solve, as given.
struct SolvingOptions {
  std::string form_factors;
  std::string device = "auto";
  std::string split = "auto";
  std::string method = "cg";
  std::string storage = "auto";
  std::string assembly = "auto";
  StopTest stop;

  [[nodiscard]] Method chosen_method() const;
};
/// --form-factors, --device, --method, --tol, --max-iterations, --iterations, --storage, --assembly
void add_solving_options(CLI::App& command, SolvingOptions& options);

/// How so many devices share F: nothing where one is used, the next one when it fails. Throws a usage Error for a
/// --split that does not fit them.
[[nodiscard]] std::optional<SplitOptions> together_of(const SolvingOptions& options, std::size_t devices);

/// The devices that were asked for. Open them before other work: one that is not there is found then.
[[nodiscard]] Candidates candidates_of(const SolvingOptions& options, ProgressSink& progress);

/// Assembles (or takes the file's form factors) and solves. `scene` is with_the_files_divide().
[[nodiscard]] PlacedSolve solve_loaded(const MeshedScene& loaded, const SceneOptions& scene,
                                       const SolvingOptions& options, Candidates& candidates, ProgressSink& progress,
                                       const Lamps& lamps = {});

}  // namespace interflect::cli
