#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <string>
#include <vector>

#include "solve_job.h"

// What several scenes are to be solved with, from the command line and from a manifest.

namespace interflect::cli {

/// Options by their long names without dashes ("tol", "output"), each with its values as the command line has them; a
/// flag has none.
using GivenOptions = std::map<std::string, std::vector<std::string>>;

struct PlannedJob {
  SolveJob job;
  GivenOptions options;  ///< with what {name} and {folder} stand for
  std::string where;     ///< for messages: "jobs.json: job 2 (b.glb)"
};

/// The options that were given to a command; not its scenes, nor what is for a run as a whole.
[[nodiscard]] GivenOptions given_options(const CLI::App& command);

/// One scene with options, as the command line would take them. In their values {name} stands for the scene's file name
/// without its extension, {folder} for the folder that it lies in. Throws a usage Error that begins with `where`.
[[nodiscard]] PlannedJob plan_job(const std::string& scene, const GivenOptions& options, const std::string& where);
/// A job for each scene, all with these options.
[[nodiscard]] std::vector<PlannedJob> plan_scenes(const std::vector<std::string>& scenes, const GivenOptions& options);

/// The jobs of a manifest: {"defaults": {...}, "jobs": [{"scene": "a.glb", "output": ["a.png"], "tol": 1e-5}, ...]}.
/// Every key but "scene" is an option of solve; a job's own come before the command line's, and these before the
/// defaults. File names are as on the command line: relative to the folder where the program runs. Throws an input
/// Error that names the file and the job for what is not so: no JSON, keys that are unknown or come twice, wrong types,
/// empty lists, options that solve does not take.
[[nodiscard]] std::vector<PlannedJob> plan_manifest(const std::string& file, const GivenOptions& command_line);

/// Throws a usage Error where two jobs would write the same file, where one would write what another one reads, or
/// where a job's outputs alone make no sense. `others` are files that are not to be written either.
void check_plan(const std::vector<PlannedJob>& jobs, const std::vector<std::string>& others);

}  // namespace interflect::cli
