#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "checkpoint.h"
#include "console.h"
#include "device_pool.h"
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
  std::string light_groups;
  bool lamps_asked = false;  ///< light_groups was given; else "auto" where there is a page, and "none" elsewhere
  PictureText picture;
  bool tell = true;                          ///< print the summary, unless --quiet
  std::function<void(const Scene&)> read{};  ///< if given, called once the scene is read
};

/// Everything about the outputs that can be wrong before the work starts. Throws a usage Error for what the options
/// say, an input Error for what cannot be written.
void check_job(const SolveJob& job);

/// Every option of a job but its scene's.
void add_job_options(CLI::App& command, SolveJob& job);

/// The files that a job is for: of the solution, and the report.
[[nodiscard]] std::vector<std::string> outputs_of(const SolveJob& job);
/// Without the report.
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
  std::size_t patches = 0;
  std::uint32_t iterations = 0;
  std::vector<std::string> devices{};

  void fail(ErrorKind kind, const std::string& why);
};
/// Reads, solves, writes, prints the summary. What ends it without a result is thrown as an Error. Devices come from
/// the pool when there is one, else they are opened for this job alone.
[[nodiscard]] JobEnd solve_job(const SolveJob& job, Console& console, DevicePool* pool = nullptr);

}  // namespace interflect::cli
