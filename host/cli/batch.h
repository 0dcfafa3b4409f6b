#pragma once

#include <string>
#include <vector>

#include "batch_plan.h"

namespace interflect::cli {

struct BatchOptions {
  std::string summary;  ///< a file for the table as JSON, up to date after every job; empty: none
  bool force = false;   ///< also what is done
  bool quiet = false;   ///< no table
  Voice voice = Voice::people;
};

/// Solves one job after the other with the same devices. A job that fails does not end the others; Ctrl-C does. Prints
/// a table of how each ended. The exit status: 130 when the user ended it, else that of the first job whose own is not
/// 0. Throws what check_plan() throws, before any work.
[[nodiscard]] int run_batch(std::vector<PlannedJob> jobs, const BatchOptions& options);

}  // namespace interflect::cli
