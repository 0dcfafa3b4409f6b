#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "batch_plan.h"

// What tells a rerun that a job is done: a note beside its first output, of what the results were made from and what
// they are. Times of files say nothing.

namespace interflect::cli {

/// The note's file; empty for a job without outputs, which is never done.
[[nodiscard]] std::string done_file(const SolveJob& job);

/// What the results depend on: this program's version, the options, and the content of every file of the scene
/// (materials, textures, buffers). Throws an input Error for a file that cannot be read.
[[nodiscard]] nlohmann::ordered_json made_from(const PlannedJob& planned, const Scene& scene);

/// Whether the outputs are there as they were written, made from what the job says now. Reads the scene and all of
/// them.
[[nodiscard]] bool is_done(const PlannedJob& planned);

/// Notes that the job is done. Throws what AtomicFile throws.
void note_done(const PlannedJob& planned, const nlohmann::ordered_json& made_from);

}  // namespace interflect::cli
