#include "bench_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>

#include "interflect/base/timer.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/check.h"
#include "interflect/device/registry.h"
#include "pipeline.h"

namespace interflect::cli {

namespace {

constexpr std::uint32_t channels = 3;

void set_times(BenchRow& row, std::vector<double> seconds) {
  row.seconds = median(seconds);
  row.seconds_min = *std::min_element(seconds.begin(), seconds.end());
  row.seconds_max = *std::max_element(seconds.begin(), seconds.end());
}

Columns test_vector(std::uint32_t n) {
  Columns x(channels, std::vector<float>(n));
  for (std::uint32_t c = 0; c < channels; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = 0.5F + static_cast<float>((i * 2654435761U + c) >> 24) / 256.0F;
  }
  return x;
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
  if (!(row.error <= row.bound)) {
    row.status = "fail";
    row.reason = "differs from the fp64 reference";
  }
}

/// One pass of the read kernel over every panel.
double read_all(Device& device, std::vector<std::unique_ptr<Buffer>>& panels, int streams) {
  double seconds = 0;
  for (auto& panel : panels) seconds += time_read(device, *panel, streams);
  return seconds;
}

std::pair<BenchRow, BenchRow> read_and_matvec(const BenchRow& base, const FormFactorMatrix& matrix,
                                              unsigned repetitions) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device(base.device));
  Device& device = *devices.front();
  Scheduler scheduler(matrix, std::move(devices), channels);
  std::vector<std::unique_ptr<Buffer>> panels;
  for (const Panel& panel : matrix.panels()) {
    panels.push_back(device.share(panel.data));
    if (panels.back() == nullptr) {
      panels.back() = device.allocate(panel.data->size());
      device.queue().upload(*panels.back(), 0, {panel.data->data(), panel.data->size()});
    }
  }
  const Columns input = test_vector(matrix.size());
  Vector x = scheduler.vector(), y = scheduler.vector();
  scheduler.upload(x, input);

  std::vector<double> read_seconds, matvec_seconds;
  constexpr int streams[] = {1, 2, 4, 8};
  for (unsigned r = 0; r <= repetitions; ++r) {  // the first pass warms up
    double best = std::numeric_limits<double>::infinity();
    for (const int count : streams) best = std::min(best, read_all(device, panels, count));
    const Timer timer;
    scheduler.apply(x, y);
    scheduler.wait();
    const double seconds = timer.seconds();
    if (r == 0) continue;
    read_seconds.push_back(best);
    matvec_seconds.push_back(seconds);
  }
  BenchRow read = base, product = base;
  read.what = "read";
  read.bytes = matrix.bytes();
  set_times(read, read_seconds);
  product.what = "matvec";
  product.bytes = matrix.bytes() + std::uint64_t{2} * channels * matrix.size() * sizeof(float);
  product.products = 1;
  set_times(product, matvec_seconds);
  std::vector<double> ratios;
  for (std::size_t r = 0; r < read_seconds.size(); ++r) ratios.push_back(read_seconds[r] / matvec_seconds[r]);
  product.a_ratio = median(ratios);
  Columns output;
  scheduler.download(y, output);
  verify_product(product, scheduler, input, output);
  return {read, product};
}

}  // namespace

std::vector<BenchRow> bench_room(const std::string& folder, const Room& room, const std::string& device,
                                 unsigned repetitions, ProgressSink& progress) {
  SceneOptions scene;
  scene.file = (std::filesystem::path(folder) / room.file).string();
  scene.divide = room.divide;
  const MeshedScene loaded = load(scene, progress);
  const FormFactors factors = assemble_checked(loaded, scene, progress);
  BenchRow base;
  base.device = device;
  base.scene = loaded.scene.name;
  base.storage = std::string(name(factors.matrix.storage()));
  base.n = factors.matrix.size();
  base.columns = channels;

  std::vector<BenchRow> rows;
  const auto [read, product] = read_and_matvec(base, factors.matrix, repetitions);
  rows.push_back(read);
  rows.push_back(product);
  for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
    BenchRow row = base;
    row.what = "solve:" + std::string(name(method));
    std::vector<double> seconds;
    for (unsigned r = 0; r < std::max(1U, repetitions / 3); ++r) {
      const Solved solved = solve_scene(factors.matrix, loaded.mesh, open_device(device), method, StopTest{}, nullptr);
      seconds.push_back(solved.report.seconds);
      row.products = solved.report.products;
      row.error = *std::max_element(solved.report.relative_residual.begin(), solved.report.relative_residual.end());
    }
    row.bound = StopTest{}.tolerance;
    if (!(row.error <= row.bound)) {
      row.status = "fail";
      row.reason = "not converged";
    }
    set_times(row, seconds);
    row.bytes = std::uint64_t{row.products} * factors.matrix.bytes();
    rows.push_back(row);
  }
  return rows;
}

nlohmann::ordered_json to_json(const BenchRow& row) {
  return {{"device", row.device},
          {"what", row.what},
          {"scene", row.scene},
          {"storage", row.storage},
          {"n", row.n},
          {"columns", row.columns},
          {"seconds", row.seconds},
          {"seconds_min", row.seconds_min},
          {"seconds_max", row.seconds_max},
          {"bytes", row.bytes},
          {"gb_per_s", row.gb_per_s()},
          {"a_ratio", row.a_ratio},
          {"products", row.products},
          {"error", row.error},
          {"bound", row.bound},
          {"status", row.status},
          {"reason", row.reason}};
}

std::string csv_header() {
  return "device,what,scene,storage,n,columns,seconds,seconds_min,seconds_max,bytes,gb_per_s,a_ratio,products,error,"
         "bound,"
         "status,reason\n";
}

std::string to_csv(const BenchRow& row) {
  return fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", row.device, row.what, row.scene,
                     row.storage, row.n, row.columns, row.seconds, row.seconds_min, row.seconds_max, row.bytes,
                     row.gb_per_s(), row.a_ratio, row.products, row.error, row.bound, row.status, row.reason);
}

std::string text_header() {
  return fmt::format("{:<9} {:<15} {:<11} {:>6} {:>11} {:>21} {:>8} {:>6} {:>5}  {:<22} {}\n", "device", "what",
                     "scene", "n", "seconds", "min .. max", "GB/s", "of A", "prod", "error of bound", "status");
}

std::string to_text(const BenchRow& row) {
  const std::string ratio = row.a_ratio > 0 ? fmt::format("{:.2f}", row.a_ratio) : "";
  const std::string error = row.bound > 0 ? fmt::format("{:.1e} of {:.1e}", row.error, row.bound) : "";
  return fmt::format("{:<9} {:<15} {:<11} {:>6} {:>11.6f} {:>9.6f} .. {:>8.6f} {:>8.2f} {:>6} {:>5}  {:<22} {}{}{}\n",
                     row.device, row.what, row.scene, row.n, row.seconds, row.seconds_min, row.seconds_max,
                     row.gb_per_s(), ratio, row.products, error, row.status, row.reason.empty() ? "" : ": ",
                     row.reason);
}

}  // namespace interflect::cli
