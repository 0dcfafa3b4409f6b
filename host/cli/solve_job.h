#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "checkpoint.h"
#include "console.h"
#include "interflect/base/error.h"
#include "lightmap_options.h"
#include "picture_options.h"
#include "pipeline.h"
#include "solving_options.h"

// One scene solved, from its file to the files of its light.

namespace interflect::cli {

/// What is to be done, as given.
struct SolveJob {
  SceneOptions scene;
  bool page = false;  ///< see SolvingCommand
  std::vector<std::string> outputs;
  LightmapOptions lightmap;
  std::string report;
  CheckpointOptions checkpoint;
  SolvingOptions solving;
  std::string light_groups;  ///< empty: "auto" where there is a page, else "none"
  PictureText picture;
};

/// Every option of a job but its scene's.
void add_job_options(CLI::App& command, SolveJob& job);

/// The files that the solution goes to.
[[nodiscard]] std::vector<std::string> result_files(const SolveJob& job);

/// The page of `view`: where none is asked for, in this folder under the scene's name. Throws a usage Error for outputs
/// without a page.
void ask_for_page(SolveJob& job);

/// How a job ended.
struct JobEnd {
  int status = 0;                      ///< the exit status
  std::optional<ErrorKind> failure{};  ///< what made it other than 0,
  std::string reason{};                ///< and why, one line
  bool whole = false;                  ///< solved as far as was asked, and everything is written

  void fail(ErrorKind kind, const std::string& why);
};
/// Reads, solves, writes, prints the summary. What ends it without a result is thrown as an Error.
[[nodiscard]] JobEnd solve_job(const SolveJob& job, Console& console);

}  // namespace interflect::cli
