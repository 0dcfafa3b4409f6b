#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "bench_row.h"

namespace interflect::cli {

/// How something is timed and judged.
struct Timed {
  std::function<double()> pass;           ///< one pass, in seconds
  std::function<void(BenchRow&)> verify;  ///< after the last pass: fills error and bound, denies what is wrong
  std::function<void()> rest = {};  ///< before and after a pass: until threads of its own no longer disturb others
};

/// A row in the making.
struct Measurement {
  BenchRow row;
  Timed timed;
  std::vector<double> seconds = {};  ///< of every pass but the first
  bool shown = true;                 ///< false: only there for the ratios of others
};

/// Appends a measurement. `prepare` makes what it needs; when that throws an Error, the row says so instead.
void add(std::vector<Measurement>& all, BenchRow row, const std::function<Timed()>& prepare, bool shown = true);

/// Times all measurements in turn, pass by pass, so that they are of the same seconds: one pass to warm up, then
/// `repetitions`; then verifies each and fills its times. A measurement that throws an Error is a row with status fail,
/// or unsupported for a limit; the others go on.
void measure(std::vector<Measurement>& all, unsigned repetitions);

/// Median, minimum, maximum, quartiles and count of the seconds, if there are any.
void set_times(BenchRow& row, const std::vector<double>& seconds);

/// Does it; an Error becomes the row's status and reason: fail, or unsupported for a limit. Whether it went through.
bool guarded(BenchRow& row, const std::function<void()>& act);

/// The measurement of a device, or null.
[[nodiscard]] const Measurement* find(const std::vector<Measurement>& all, std::string_view device,
                                      std::string_view what);

/// The median over the passes of (seconds of `other`) / (seconds of `one`); 0 when either has none.
[[nodiscard]] double median_ratio(const Measurement& other, const Measurement& one);

}  // namespace interflect::cli
