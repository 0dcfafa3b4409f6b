#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace interflect::cli {

/// Where a stage stands.
struct StageState {
  std::string stage;
  std::uint64_t done = 0, total = 0;  ///< total 0: not known
  double seconds = 0;                 ///< since its begin
  // The solver's, once it has done an iteration.
  std::uint32_t iteration = 0;
  double residual = 0;
  std::uint32_t job = 0, jobs = 0;  ///< of several; 0: there is one

  /// 0 to 1; 0 where the total is not known.
  [[nodiscard]] double share() const;
  /// Steps per second (of the stage "Solve": iterations); 0 before anything is done.
  [[nodiscard]] double rate() const;
  /// What is left at the rate so far; nothing where too little is done to say.
  [[nodiscard]] std::optional<double> seconds_left() const;
};

/// What a step of this stage is, in the plural: "tiles", "rows", "frames", "iterations"; else "steps".
[[nodiscard]] std::string_view unit_of(std::string_view stage);

/// "form factors   [######......]  50 %  1.2k tiles/s  3 s left" in `columns` at most; of the solver also the iteration
/// and its residual; of several jobs "2/5 " in front. A stage of unknown length has no bar but says how long it has
/// taken.
[[nodiscard]] std::string bar_line(const StageState& state, std::size_t columns);

/// The same for programs: one object with stage, state ("begin", "running", "end"), done, total, unit, rate, seconds,
/// seconds_left (null: not known); of the solver also iteration and residual; of several jobs also job and jobs.
[[nodiscard]] nlohmann::ordered_json progress_json(const StageState& state, std::string_view moment);

}  // namespace interflect::cli
