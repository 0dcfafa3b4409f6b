#include "progress_line.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace interflect::cli {

namespace {

std::string duration(double seconds) {
  if (seconds < 10) return fmt::format("{:.1f} s", seconds);
  if (seconds < 60) return fmt::format("{:.0f} s", seconds);
  if (seconds < 3600) {
    const auto whole = static_cast<std::uint64_t>(seconds);
    return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  }
  constexpr double longest = 1e9;  // a bar that has only begun may guess anything
  const auto minutes = static_cast<std::uint64_t>(std::min(seconds, longest) / 60);
  return fmt::format("{} h {:02} min", minutes / 60, minutes % 60);
}

/// 3 digits and a letter: 1.24k, 35.2M, 512.
std::string short_number(double value) {
  constexpr std::array<std::pair<double, const char*>, 3> units{{{1e9, "G"}, {1e6, "M"}, {1e3, "k"}}};
  for (const auto& [size, letter] : units) {
    if (value >= size) return fmt::format("{:.3g}{}", value / size, letter);
  }
  return fmt::format("{:.3g}", value);
}

}  // namespace

double StageState::share() const {
  return total == 0 ? 0 : std::min(1.0, static_cast<double>(done) / static_cast<double>(total));
}

double StageState::rate() const {
  const double steps = stage == "Solve" ? static_cast<double>(iteration) : static_cast<double>(done);
  return seconds > 0 ? steps / seconds : 0;
}

std::optional<double> StageState::seconds_left() const {
  const double part = share();
  if (part < 0.01) return std::nullopt;
  return seconds / part * (1 - part);
}

std::string_view unit_of(std::string_view stage) {
  if (stage == "form factors") return "tiles";
  if (stage == "Solve") return "iterations";
  if (stage == "Picture") return "rows";
  if (stage == "Frames") return "frames";
  if (stage == "Write") return "files";
  return "steps";
}

std::string bar_line(const StageState& state, std::size_t columns) {
  std::string end;
  if (state.iteration > 0) end += fmt::format("  iteration {}, residual {:.1e}", state.iteration, state.residual);
  if (state.rate() > 0) {
    end += fmt::format("  {} {}/s", short_number(state.rate()), state.iteration > 0 ? "it" : unit_of(state.stage));
  }
  if (const auto left = state.seconds_left()) end += fmt::format("  {} left", duration(*left));
  std::string line = state.jobs > 0 ? fmt::format("{}/{} ", state.job, state.jobs) : "";
  line += fmt::format("{:<14} ", state.stage);
  if (state.total == 0) return (line + duration(state.seconds) + end).substr(0, columns);
  end = fmt::format(" {:3.0f} %", std::floor(state.share() * 100)) + end;
  // The bar itself gives way to what stands behind it.
  constexpr std::size_t shortest = 5, longest = 20, brackets = 2;
  const std::size_t others = line.size() + end.size() + brackets;
  const std::size_t width = std::clamp(columns > others ? columns - others : 0, shortest, longest);
  const auto filled = static_cast<std::size_t>(state.share() * static_cast<double>(width));
  line += fmt::format("[{}{}]", std::string(filled, '#'), std::string(width - filled, '.'));
  return (line + end).substr(0, columns);
}

nlohmann::ordered_json progress_json(const StageState& state, std::string_view moment) {
  nlohmann::ordered_json out;
  if (state.jobs > 0) {
    out["job"] = state.job;
    out["jobs"] = state.jobs;
  }
  out["stage"] = state.stage;
  out["state"] = std::string(moment);
  out["done"] = state.done;
  out["total"] = state.total;
  out["unit"] = state.stage == "Solve" ? "percent" : std::string(unit_of(state.stage));
  out["rate"] = state.rate();
  out["seconds"] = state.seconds;
  const auto left = state.seconds_left();
  out["seconds_left"] = left ? nlohmann::ordered_json(*left) : nlohmann::ordered_json(nullptr);
  if (state.iteration > 0) {
    out["iteration"] = state.iteration;
    // JSON has no number for a residual that is not finite.
    out["residual"] = std::isfinite(state.residual) ? nlohmann::ordered_json(state.residual) : nullptr;
  }
  return out;
}

}  // namespace interflect::cli
