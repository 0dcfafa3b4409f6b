#include "bench_hybrid.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <memory>
#include <utility>

#include "bench_place.h"
#include "bench_rows.h"
#include "interflect/base/timer.h"
#include "interflect/device/registry.h"
#include "measurement.h"
#include "slowed_device.h"
#include "study.h"

namespace interflect::cli {

namespace {

using Devices = std::vector<std::unique_ptr<Device>>;
using Open = std::function<std::unique_ptr<Device>()>;

constexpr double rate = 1e9;  // bytes a second: slow enough for two on a core, and on a busy machine
constexpr int products_to_learn = 20;

/// F over some devices.
struct Team {
  Team(const Stored& matrix, Devices devices)
      : scheduler(matrix.place(std::move(devices), bench_channels)), x(scheduler->vector()), y(scheduler->vector()) {
    scheduler->upload(x, test_vector(scheduler->size()));
    for (int k = 0; k < products_to_learn; ++k) scheduler->apply(x, y);
    scheduler->wait();
  }
  std::unique_ptr<Scheduler> scheduler;
  Vector x, y;
};

Timed multiplying(const std::shared_ptr<Team>& team, double bound) {
  return {.pass =
              [team] {
                const Timer timer;
                team->scheduler->apply(team->x, team->y);
                team->scheduler->wait();
                return timer.seconds();
              },
          .verify =
              [team, bound](BenchRow& judged) {
                Columns y;
                team->scheduler->download(team->y, y);
                std::vector<std::vector<double>> exact;
                team->scheduler->exact_product(test_vector(team->scheduler->size()), exact);
                for (std::size_t c = 0; c < y.size(); ++c) {
                  for (std::size_t i = 0; i < y[c].size(); ++i) {
                    const double relative = std::abs(static_cast<double>(y[c][i]) - exact[c][i]) / exact[c][i];
                    judged.error = relative <= judged.error ? judged.error : relative;  // also takes a NaN
                  }
                }
                judged.bound = bound;
                if (!(judged.error <= judged.bound)) deny(judged, "differs from the fp64 reference");
                for (const DeviceShare& share : team->scheduler->shares()) {
                  judged.note +=
                      fmt::format("{}{} {:.1f} %", judged.note.empty() ? "" : ", ", share.device, 100 * share.share);
                }
                for (const DeviceFailure& lost : team->scheduler->failures()) deny(judged, lost.reason);
              }};
}

/// Each alone and all together; `names` are those of the rows.
std::vector<BenchRow> together(const Stored& matrix, const std::vector<Open>& open,
                               const std::vector<std::string>& names, const std::string& all_names,
                               unsigned repetitions) {
  std::vector<Measurement> all;
  const auto add_row = [&](const std::string& name, const std::function<Devices()>& devices) {
    BenchRow row;
    row.device = name;
    row.what = "matvec";
    row.scene = "random";
    row.columns = bench_channels;
    matrix.describe_product(row);
    add(all, row, [&] { return multiplying(std::make_shared<Team>(matrix, devices()), matrix.bound()); });
  };
  for (std::size_t k = 0; k < open.size(); ++k) {
    add_row(names[k], [&] {
      Devices one;
      one.push_back(open[k]());
      return one;
    });
  }
  add_row(all_names, [&] {
    Devices devices;
    for (const Open& one : open) devices.push_back(one());
    return devices;
  });
  all.back().row.what = "hybrid";
  measure(all, repetitions);
  std::vector<double> ratios;
  for (std::size_t pass = 0; pass < all.back().seconds.size(); ++pass) {
    double rate = 0;
    for (std::size_t k = 0; k < open.size(); ++k) {
      if (pass < all[k].seconds.size()) rate += 1 / all[k].seconds[pass];
    }
    ratios.push_back(all.back().seconds[pass] * rate);
  }
  if (!ratios.empty()) {
    all.back().row.note = fmt::format("{:.2f} of the ideal time; {}", median(ratios), all.back().row.note);
  }
  std::vector<BenchRow> rows;
  for (const Measurement& one : all) rows.push_back(one.row);
  return rows;
}

}  // namespace

std::vector<BenchRow> bench_hybrid(const std::vector<std::string>& devices, std::uint32_t n, unsigned repetitions) {
  const FormFactorMatrix dense = random_form_factors(n);
  const std::vector<double> area(n, 1.0);
  const Stored matrix(dense, area, Storage::dense32, 0);
  const auto slowed = [&](const char* name, double part) -> Open {
    return [=] { return std::make_unique<SlowedDevice>(open_device("openmp"), name, part * rate); };
  };
  std::vector<BenchRow> rows =
      together(matrix, {slowed("slowed", 1), slowed("quarter", 0.25)}, {"slowed", "quarter"}, "1:4 pair", repetitions);
  if (devices.size() < 2) return rows;
  std::vector<Open> open;
  std::string names;
  for (const std::string& one : devices) {
    open.emplace_back([one] { return open_device(one); });
    names += (names.empty() ? "" : "+") + one;
  }
  const std::vector<BenchRow> real = together(matrix, open, devices, names, repetitions);
  rows.insert(rows.end(), real.begin(), real.end());
  return rows;
}

}  // namespace interflect::cli
