#pragma once

#include <string>
#include <vector>

#include "kept.h"
#include "launch.h"
#include "place.h"
#include "solving_options.h"

// A solve by several ranks.

namespace interflect::cli {

/// The devices that this process may use: choose_devices(). Of several ranks on a machine, with `auto` one, the local
/// rank's in turn, of the GPUs (openmp where there is none); those that are named are dealt out among them, and a rank
/// that gets several uses them together.
[[nodiscard]] std::vector<std::string> devices_of_rank(const std::string& text);

/// solve_loaded() where there are several ranks: collective. Everything but the factors' matrix, which has the rank's
/// rows, is the same on every rank; warnings, figures of the assembly and of all panels are rank 0's. Throws a usage
/// Error for what does not run on several ranks.
[[nodiscard]] PlacedSolve solve_on_ranks(const MeshedScene& loaded, const SceneOptions& scene,
                                         const SolvingOptions& options, Candidates& candidates, ProgressSink& progress,
                                         const Lamps& lamps);

/// Computes the form factors and keeps them in FILE, as keep(), by all ranks; no matrix is returned.
[[nodiscard]] KeptFormFactors keep_on_ranks(const std::string& file, const MeshedScene& loaded,
                                            const SceneOptions& options, Assembler& assembler, ProgressSink& progress);

}  // namespace interflect::cli
