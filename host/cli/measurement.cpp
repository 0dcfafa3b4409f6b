#include "measurement.h"

#include <algorithm>
#include <utility>

#include "interflect/base/error.h"
#include "report.h"
#include "study.h"

namespace interflect::cli {

namespace {

/// Does it; an Error becomes the row's status and reason, and the measurement's end.
template <class Act>
void guarded(Measurement& measurement, Act act) {
  try {
    act();
  } catch (const Error& error) {
    deny(measurement.row, std::string(first_line(error.what())));
    if (error.kind() == ErrorKind::limit) measurement.row.status = "unsupported";
    measurement.timed = {};
  }
}

void set_times(Measurement& measurement) {
  const std::vector<double>& seconds = measurement.seconds;
  if (seconds.empty()) return;
  measurement.row.seconds = median(seconds);
  measurement.row.seconds_min = *std::min_element(seconds.begin(), seconds.end());
  measurement.row.seconds_max = *std::max_element(seconds.begin(), seconds.end());
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
    set_times(one);
    if (one.timed.verify) guarded(one, [&] { one.timed.verify(one.row); });
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
