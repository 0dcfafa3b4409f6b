#include "bench_place.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "interflect/base/timer.h"
#include "interflect/device/registry.h"

namespace interflect::cli {

namespace {

/// Places F through `device`, which stays with the Scheduler. `seconds` gets the time less that of the compiler.
std::unique_ptr<Scheduler> placed(std::unique_ptr<Device> device, const Stored& matrix, double& seconds) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::move(device));
  const Timer timer;
  auto scheduler = matrix.place(std::move(devices), bench_channels);
  scheduler->wait();
  seconds = std::max(0.0, timer.seconds() - scheduler->compile_seconds());
  return scheduler;
}

std::unique_ptr<CountingDevice> opened(const std::string& id, CountingDevice*& seen) {
  auto device = std::make_unique<CountingDevice>(open_device(id));
  seen = device.get();
  return device;
}

}  // namespace

Columns test_vector(std::uint32_t n) {
  Columns x(bench_channels, std::vector<float>(n));
  for (std::uint32_t c = 0; c < bench_channels; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = 0.5F + static_cast<float>((i * 2654435761U + c) >> 24) / 256.0F;
  }
  return x;
}

Place::Place(const std::string& id, const Stored& matrix)
    : bound_(matrix.bound()),
      scheduler_(placed(opened(id, device_), matrix, upload_seconds_)),
      x_(scheduler_->vector()),
      y_(scheduler_->vector()) {
  for (const char* kernel : {"bounce", "cg_product", "cg_step", "bicgstab_product", "bicgstab_half", "bicgstab_step"}) {
    static_cast<void>(scheduler_->kernel(kernel));
  }
  const CompileStatistics now = compile_statistics();
  compiled_.compiled = now.compiled - compiled_.compiled;
  compiled_.from_cache = now.from_cache - compiled_.from_cache;
  scheduler_->upload(x_, test_vector(scheduler_->size()));
  if (matrix.storage() != Storage::dense32) return;
  for (const int streams : reader_streams) readers_.emplace_back(*device_, scheduler_->panel_buffers(), streams);
}

Timed reading(const SharedPlace& place, double exact) {
  return {.pass =
              [place] {
                double best = std::numeric_limits<double>::infinity();
                for (Reader& reader : place->readers()) best = std::min(best, reader.seconds());
                return best;
              },
          .verify =
              [place, exact](BenchRow& judged) {
                for (Reader& reader : place->readers()) {
                  double total = 0;
                  for (const float sum : reader.sums()) total += static_cast<double>(sum);
                  const double error = std::abs(total - exact) / exact;
                  judged.error = error <= judged.error ? judged.error : error;  // also takes a NaN
                  judged.bound = reader.bound();
                }
                if (!(judged.error <= judged.bound)) deny(judged, "the sums are not those of F");
              }};
}

void verify_product(BenchRow& row, Place& place) {
  Columns y;
  place.scheduler().download(place.y(), y);
  std::vector<std::vector<double>> exact;
  place.scheduler().exact_product(test_vector(place.scheduler().size()), exact);
  // The largest |y − F x| / Σ|F||x|: all terms are positive.
  for (std::uint32_t c = 0; c < bench_channels; ++c) {
    for (std::uint32_t i = 0; i < place.scheduler().size(); ++i) {
      const double difference = std::abs(static_cast<double>(y[c][i]) - exact[c][i]);
      const double relative = exact[c][i] > 0 ? difference / exact[c][i] : difference;
      row.error = relative <= row.error ? row.error : relative;
    }
  }
  row.bound = place.bound();
  if (!(row.error <= row.bound)) deny(row, "differs from the fp64 reference");
}

Timed multiplying(const SharedPlace& place) {
  return {.pass =
              [place] {
                const Timer timer;
                place->scheduler().apply(place->x(), place->y());
                place->scheduler().wait();
                return timer.seconds();
              },
          .verify = [place](BenchRow& judged) { verify_product(judged, *place); }};
}

}  // namespace interflect::cli
