#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "bench_launch.h"
#include "bench_rows.h"
#include "bench_vectors.h"
#include "interflect/base/error.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/registry.h"
#include "measurement.h"

namespace interflect::cli {

namespace {

constexpr std::uint64_t wanted_bytes = std::uint64_t{256} << 20;  // beyond any cache

/// Read: the best of the stream counts in every pass; the sums are held against the number of ones put in.
Timed reading(const SharedDevice& device, BenchRow& row) {
  row.bytes = measurable_bytes(device->info(), wanted_bytes);
  const std::shared_ptr<Buffer> ones = device->allocate(row.bytes);
  fill(*device, *ones, 1);
  const auto readers = std::make_shared<std::vector<Reader>>();
  for (const int streams : reader_streams) readers->emplace_back(*device, std::vector{ones.get()}, streams);
  return {.pass =
              [device, ones, readers] {
                double best = std::numeric_limits<double>::infinity();
                for (Reader& reader : *readers) best = std::min(best, reader.seconds());
                return best;
              },
          .verify =
              [device, ones, readers](BenchRow& judged) {
                const std::uint64_t floats = judged.bytes / sizeof(float);
                const auto count = static_cast<double>(floats);
                for (Reader& reader : *readers) {
                  double total = 0;
                  for (const float sum : reader.sums()) total += static_cast<double>(sum);
                  const double error = std::abs(total - count) / count;
                  judged.error = error <= judged.error ? judged.error : error;  // also takes a NaN
                }
                if (judged.error != 0) deny(judged, "the sums are not those of what was put in");
              }};
}

Timed copying(const SharedDevice& device, BenchRow& row) {
  const std::uint64_t bytes = measurable_bytes(device->info(), wanted_bytes);
  row.bytes = 2 * bytes;
  row.bytes_written = bytes;
  const std::shared_ptr<Buffer> from = device->allocate(bytes), to = device->allocate(bytes);
  fill(*device, *from, 1);
  fill(*device, *to, 0);
  const auto lines = static_cast<std::uint32_t>(bytes / 64);
  const std::uint32_t groups = stream_groups(device->info(), lines);
  const auto launch = std::make_shared<Launch>(device, "copy", block_of(StreamArguments{lines}), groups,
                                               std::vector<std::shared_ptr<Buffer>>{from, to});
  return {.pass = [launch] { return launch->seconds(1); },
          .verify =
              [device, to, launch](BenchRow& judged) {
                if (!filled_with(*device, *to, 1)) deny(judged, "the copy differs from what was copied");
              }};
}

/// The smallest launch, of a copy of one cache line.
Timed launching(const SharedDevice& device, int batch, int batches) {
  const std::shared_ptr<Buffer> from = device->allocate(64), to = device->allocate(64);
  fill(*device, *from, 3);
  const auto launch = std::make_shared<Launch>(device, "copy", block_of(StreamArguments{1}), 1,
                                               std::vector<std::shared_ptr<Buffer>>{from, to});
  return {.pass =
              [launch, batch, batches] {
                double seconds = 0;
                for (int k = 0; k < batches; ++k) seconds += launch->seconds(batch) / batches;
                return seconds;
              },
          .verify =
              [launch](BenchRow& judged) {
                if (launch->floats(1, 16) != std::vector<float>(16, 3)) deny(judged, "the launch did not do its work");
              }};
}

void add_device(std::vector<Measurement>& all, const std::string& id) {
  BenchRow row;
  row.device = id;
  SharedDevice device;
  const auto named = [&](const char* what) {
    row.what = what;
    return row;
  };
  try {
    device = open_device(id);
  } catch (const Error& error) {
    add(all, named("read"), [&]() -> Timed { throw error; });
    return;
  }
  const auto with_bytes = [&](const char* what, Timed (*prepare)(const SharedDevice&, BenchRow&)) {
    BenchRow filled = named(what);
    add(all, filled, [&] { return prepare(device, filled); });
    all.back().row.bytes = filled.bytes;
    all.back().row.bytes_written = filled.bytes_written;
  };
  with_bytes("read", &reading);
  with_bytes("copy", &copying);
  add(all, named("launch"), [&] { return launching(device, 100, 1); });
  add(all, named("launch+wait"), [&] { return launching(device, 1, 20); });
  add_vector_kernels(all, device);
}

const BenchRow* verified(const std::vector<BenchRow>& rows, const std::string& device, std::string_view what) {
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const BenchRow& row) {
    return row.device == device && row.what == what && row.scene.empty() && row.status == "pass";
  });
  return found == rows.end() ? nullptr : &*found;
}

}  // namespace

double device_rate(const std::vector<BenchRow>& rows, const std::string& device, std::string_view what) {
  const BenchRow* row = verified(rows, device, what);
  return row == nullptr ? 0 : row->gb_per_s();
}

double launch_seconds(const std::vector<BenchRow>& rows, const std::string& device) {
  const BenchRow* row = verified(rows, device, "launch");
  return row == nullptr ? 0 : row->seconds_min;
}

std::vector<BenchRow> bench_devices(const std::vector<std::string>& devices, unsigned repetitions) {
  std::vector<Measurement> all;
  for (const std::string& id : devices) add_device(all, id);
  measure(all, repetitions);
  std::vector<BenchRow> rows;
  rows.reserve(all.size());
  for (const Measurement& one : all) rows.push_back(one.row);
  for (BenchRow& row : rows) {
    set_ceiling(row, device_rate(rows, row.device, "read"), device_rate(rows, row.device, "copy"));
  }
  return rows;
}

}  // namespace interflect::cli
