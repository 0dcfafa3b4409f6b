#include "measurement.h"

#include <algorithm>
#include <utility>

#include "interflect/base/error.h"
#include "report.h"
#include "study.h"

namespace interflect::cli {

namespace {

/// The value below which a share of the values lies, between two of them on the line through both. Not of no values.
double quartile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  const double place = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (place - static_cast<double>(below)) * (values[above] - values[below]);
}

/// The measurement's end when its row is not to go on.
void guarded(Measurement& measurement, const std::function<void()>& act) {
  if (!guarded(measurement.row, act)) measurement.timed = {};
}

/// Seconds of one pass. A short one is done several times, after one that is not timed: what the devices before it have
/// put to sleep or driven out of the caches is back then.
double seconds_of(const Measurement& measurement) {
  constexpr double long_enough = 2e-3;
  constexpr int most = 50;
  const double first = measurement.timed.pass();
  const double usual = measurement.seconds.empty() ? first : measurement.seconds.back();
  if (usual >= long_enough) return first;
  double total = 0;
  int count = 0;
  do {
    total += measurement.timed.pass();
    ++count;
  } while (total < long_enough && count < most);
  return total / count;
}

}  // namespace

bool guarded(BenchRow& row, const std::function<void()>& act) {
  try {
    act();
    return true;
  } catch (const Error& error) {
    deny(row, std::string(first_line(error.what())));
    if (error.kind() == ErrorKind::limit) row.status = "unsupported";
    return false;
  }
}

void set_times(BenchRow& row, const std::vector<double>& seconds) {
  if (seconds.empty()) return;
  row.seconds = median(seconds);
  row.seconds_min = *std::min_element(seconds.begin(), seconds.end());
  row.seconds_max = *std::max_element(seconds.begin(), seconds.end());
  row.seconds_iqr = quartile(seconds, 0.75) - quartile(seconds, 0.25);
  row.repetitions = static_cast<std::uint32_t>(seconds.size());
}

void add(std::vector<Measurement>& all, BenchRow row, const std::function<Timed()>& prepare, bool shown) {
  Measurement& added = all.emplace_back(Measurement{.row = std::move(row), .timed = {}, .seconds = {}, .shown = shown});
  guarded(added, [&] { added.timed = prepare(); });
}

void measure(std::vector<Measurement>& all, unsigned repetitions) {
  for (unsigned pass = 0; pass <= repetitions; ++pass) {
    for (Measurement& one : all) {
      if (!one.timed.pass) continue;
      guarded(one, [&] {
        if (one.timed.rest) one.timed.rest();
        const double seconds = seconds_of(one);
        if (one.timed.rest) one.timed.rest();
        if (pass > 0) one.seconds.push_back(seconds);
      });
    }
  }
  for (Measurement& one : all) {
    set_times(one.row, one.seconds);
    if (one.timed.verify) guarded(one, [&] { one.timed.verify(one.row); });
    one.timed = {};  // what it holds may be large
  }
}

const Measurement* find(const std::vector<Measurement>& all, std::string_view device, std::string_view what) {
  const auto found = std::find_if(
      all.begin(), all.end(), [&](const Measurement& one) { return one.row.device == device && one.row.what == what; });
  return found == all.end() ? nullptr : &*found;
}

double median_ratio(const Measurement& other, const Measurement& one) {
  std::vector<double> ratios;
  for (std::size_t k = 0; k < std::min(other.seconds.size(), one.seconds.size()); ++k) {
    ratios.push_back(other.seconds[k] / one.seconds[k]);
  }
  return median(ratios);
}

}  // namespace interflect::cli
