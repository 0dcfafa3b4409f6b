#pragma once

#include <string>

#include "interflect/serve/live_solver.h"

namespace interflect::cli {

/// What edits in the page cost: one wall's reflectance goes back and forth, and each time the whole answer is made.
struct LiveMeasurement {
  std::string wall;  ///< the material with the largest area that does not emit
  std::uint32_t solves = 0;
  double cold_seconds = 0;  ///< of a solve that begins at 0
  std::uint32_t cold_products = 0;
  double seconds = 0;            ///< median
  double products = 0;           ///< mean per solve
  double processor_seconds = 0;  ///< of all threads, mean per solve
  bool converged = true;
};

/// For about so many seconds, at least five solves each way.
[[nodiscard]] LiveMeasurement measure_live(serve::LiveSolver& solver, const serve::LiveScene& scene, double tolerance,
                                           double seconds);

/// The table's head, and a line of it.
[[nodiscard]] std::string live_table_head();
[[nodiscard]] std::string live_table_line(const std::string& scene, const serve::LiveScene& live,
                                          const serve::LiveSolution& last, const LiveMeasurement& measured);

}  // namespace interflect::cli
