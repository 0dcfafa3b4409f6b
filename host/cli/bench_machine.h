#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace interflect::cli {

/// MHz of the processor, where the machine tells them.
struct Clock {
  std::optional<double> now, most;
};
/// From cpufreq below `root`/sys, else the fastest "cpu MHz" of `root`/proc/cpuinfo; `root` is empty outside of tests.
[[nodiscard]] Clock processor_clock(const std::string& root = "");

/// Of the last 1, 5 and 15 minutes; empty when the machine does not tell.
[[nodiscard]] std::vector<double> load_average();

/// The environment's INTERFLECT_* and OMP_* variables, by name.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> settings();

/// Now, as "2026-11-22T13:45:00Z".
[[nodiscard]] std::string utc_now();

}  // namespace interflect::cli
