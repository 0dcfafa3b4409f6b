#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "bench_peers.h"
#include "bench_rows.h"
#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/check.h"
#include "interflect/device/registry.h"
#include "measurement.h"
#include "pipeline.h"

namespace interflect::cli {

namespace {

constexpr std::uint32_t channels = 3;

/// A room with its form factors.
struct Loaded {
  MeshedScene scene;
  FormFactors factors;
  double sum = 0;  ///< of all form factors, in double
};

Columns test_vector(std::uint32_t n) {
  Columns x(channels, std::vector<float>(n));
  for (std::uint32_t c = 0; c < channels; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = 0.5F + static_cast<float>((i * 2654435761U + c) >> 24) / 256.0F;
  }
  return x;
}

/// A device with F on it.
struct Placed {
  Placed(const std::string& id, const FormFactorMatrix& matrix) : scheduler(matrix, opened(id), channels) {
    for (const int streams : reader_streams)
      readers.emplace_back(scheduler.device(), scheduler.panel_buffers(), streams);
  }
  static std::vector<std::unique_ptr<Device>> opened(const std::string& id) {
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(open_device(id));
    return devices;
  }
  Scheduler scheduler;
  std::vector<Reader> readers;
  Vector x = scheduler.vector(), y = scheduler.vector();
};
using SharedPlace = std::shared_ptr<Placed>;

/// The best of the stream counts in every pass; the sums of F are held against those in double.
Timed reading(const SharedPlace& place, double exact) {
  return {.pass =
              [place] {
                double best = std::numeric_limits<double>::infinity();
                for (Reader& reader : place->readers) best = std::min(best, reader.seconds());
                return best;
              },
          .verify =
              [place, exact](BenchRow& judged) {
                for (Reader& reader : place->readers) {
                  double total = 0;
                  for (const float sum : reader.sums()) total += static_cast<double>(sum);
                  const double error = std::abs(total - exact) / exact;
                  judged.error = error <= judged.error ? judged.error : error;  // also takes a NaN
                  judged.bound = reader.bound();
                }
                if (!(judged.error <= judged.bound)) deny(judged, "the sums are not those of F");
              }};
}

/// The largest |y − F x| / Σ|F||x| (all terms are positive) against the product in double, and the kernel's own bound.
void verify_product(BenchRow& row, Scheduler& scheduler, const Columns& x, const Columns& y) {
  std::vector<std::vector<double>> exact;
  scheduler.exact_product(x, exact);
  for (std::uint32_t c = 0; c < channels; ++c) {
    for (std::uint32_t i = 0; i < row.n; ++i) {
      const double difference = std::abs(static_cast<double>(y[c][i]) - exact[c][i]);
      const double relative = exact[c][i] > 0 ? difference / exact[c][i] : difference;
      row.error = relative <= row.error ? row.error : relative;
    }
  }
  row.bound = matvec_bound(row.n);
  if (!(row.error <= row.bound)) deny(row, "differs from the fp64 reference");
}

Timed multiplying(const SharedPlace& place) {
  place->scheduler.upload(place->x, test_vector(place->scheduler.size()));
  return {.pass =
              [place] {
                const Timer timer;
                place->scheduler.apply(place->x, place->y);
                place->scheduler.wait();
                return timer.seconds();
              },
          .verify =
              [place](BenchRow& judged) {
                Columns output;
                place->scheduler.download(place->y, output);
                verify_product(judged, place->scheduler, test_vector(judged.n), output);
              }};
}

Timed solving(const SharedPlace& place, const Loaded& room, Method method) {
  const auto last = std::make_shared<SolveReport>();
  return {.pass =
              [place, last, method, &room] {
                *last = solve_placed(place->scheduler, room.scene.mesh, method, StopTest{}).report;
                return last->seconds;
              },
          .verify =
              [last, &room](BenchRow& judged) {
                judged.products = last->products;
                judged.bytes = std::uint64_t{last->products} * room.factors.matrix.bytes();
                judged.error = *std::max_element(last->relative_residual.begin(), last->relative_residual.end());
                judged.bound = StopTest{}.tolerance;
                if (!(judged.error <= judged.bound)) deny(judged, "not converged");
              }};
}

void add_room_peers(std::vector<Measurement>& all, const std::vector<std::pair<BenchRow, SharedPlace>>& places,
                    const FormFactorMatrix& matrix, const std::vector<peers::Peer>& peers) {
  add_peers(all, places.front().first, peers,
            std::make_shared<peers::Problem>(matrix, test_vector(matrix.size()), ::omp_get_max_threads()));
}

/// Read and matvec of each device, in turn, and the peers between them; the ratios are of the same passes.
std::vector<BenchRow> products(const std::vector<std::pair<BenchRow, SharedPlace>>& places, const Loaded& room,
                               unsigned repetitions, const SharedPlace& machine,
                               const std::vector<peers::Peer>& peers) {
  const FormFactorMatrix& matrix = room.factors.matrix;
  std::vector<Measurement> all;
  for (const auto& entry : places) {
    const SharedPlace& place = entry.second;
    BenchRow row = entry.first;
    row.what = "read";
    row.bytes = matrix.bytes();
    add(all, row, [&] { return reading(place, room.sum); });
    row.what = "matvec";
    row.bytes += std::uint64_t{2} * channels * matrix.size() * sizeof(float);
    row.products = 1;
    add(all, row, [&] { return multiplying(place); });
  }
  if (machine != nullptr) {
    BenchRow row;
    row.device = "machine";
    row.what = "read";
    add(
        all, row, [&] { return reading(machine, room.sum); }, false);
  }
  if (!peers.empty()) add_room_peers(all, places, matrix, peers);
  measure(all, repetitions);

  const auto cpu = [&](const std::string& id) {
    return std::any_of(places.begin(), places.end(), [&](const auto& place) {
      return place.first.device == id && place.second->scheduler.device().info().type == DeviceType::cpu;
    });
  };
  const Measurement* reference = find(all, "openmp", "read");
  if (reference == nullptr) reference = find(all, "machine", "read");
  std::vector<BenchRow> rows;
  for (Measurement& one : all) {
    if (!one.shown) continue;
    const Measurement* read = find(all, one.row.device, "read");
    if (one.row.what == "matvec" && read != nullptr) one.row.a_ratio = median_ratio(*read, one);
    if (one.row.what.starts_with("peer:")) {
      if (read == nullptr) read = reference;  // on the host
      if (read != nullptr) one.row.a_ratio = median_ratio(*read, one);
    }
    if (reference != nullptr && (cpu(one.row.device) || one.row.device == "host") && !one.seconds.empty()) {
      one.row.machine_ratio = median_ratio(*reference, one);
    }
    rows.push_back(one.row);
  }
  return rows;
}

std::vector<BenchRow> solves(const std::vector<std::pair<BenchRow, SharedPlace>>& places, const Loaded& room,
                             unsigned repetitions) {
  std::vector<Measurement> all;
  for (const auto& entry : places) {
    const SharedPlace& place = entry.second;
    for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
      BenchRow row = entry.first;
      row.what = "solve:" + std::string(name(method));
      add(all, row, [&] { return solving(place, room, method); });
    }
  }
  measure(all, repetitions);
  std::vector<BenchRow> rows;
  rows.reserve(all.size());
  for (const Measurement& one : all) rows.push_back(one.row);
  return rows;
}

Loaded load_room(const std::string& folder, const Room& room, ProgressSink& progress) {
  SceneOptions options;
  options.file = (std::filesystem::path(folder) / room.file).string();
  options.divide = room.divide;
  MeshedScene scene = load(options, progress);
  FormFactors factors = assemble_checked(scene, options, progress);
  double sum = 0;
  for (const double row : factors.matrix.row_sums()) sum += row;
  return {std::move(scene), std::move(factors), sum};
}

}  // namespace

std::vector<BenchRow> bench_room(const std::string& folder, const Room& room, const std::vector<std::string>& devices,
                                 unsigned repetitions, bool with_peers, ProgressSink& progress) {
  const Loaded loaded = load_room(folder, room, progress);
  const FormFactorMatrix& matrix = loaded.factors.matrix;
  std::vector<BenchRow> rows;
  std::vector<std::pair<BenchRow, SharedPlace>> places;
  bool any_cpu = false, has_openmp = false;
  for (const std::string& id : devices) {
    BenchRow base;
    base.device = id;
    base.scene = loaded.scene.scene.name;
    base.storage = std::string(name(matrix.storage()));
    base.n = matrix.size();
    base.columns = channels;
    std::vector<Measurement> placing;
    SharedPlace place;
    base.what = "matvec";
    add(placing, base, [&] {
      place = std::make_shared<Placed>(id, matrix);
      return Timed{};
    });
    if (place == nullptr) {
      rows.push_back(placing.front().row);
      continue;
    }
    places.emplace_back(base, place);
    any_cpu = any_cpu || place->scheduler.device().info().type == DeviceType::cpu;
    has_openmp = has_openmp || id == "openmp";
  }
  // What the machine's memory gives in the same seconds: F is shared, so that it costs none.
  const SharedPlace machine =
      (any_cpu || with_peers) && !has_openmp ? std::make_shared<Placed>("openmp", matrix) : nullptr;
  const auto append = [&](const std::vector<BenchRow>& more) { rows.insert(rows.end(), more.begin(), more.end()); };
  const auto peers = with_peers && !places.empty() ? peers::all_peers(devices) : std::vector<peers::Peer>{};
  append(products(places, loaded, repetitions, machine, peers));
  append(solves(places, loaded, std::max(1U, repetitions / 3)));
  return rows;
}

}  // namespace interflect::cli
