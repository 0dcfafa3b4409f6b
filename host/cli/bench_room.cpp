#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <utility>

#include "bench_peers.h"
#include "bench_place.h"
#include "bench_rows.h"
#include "interflect/base/error.h"
#include "measurement.h"
#include "pipeline.h"

namespace interflect::cli {

namespace {

/// A room with its form factors.
struct Loaded {
  MeshedScene scene;
  FormFactors factors;
  double sum = 0;       ///< of all form factors, in double
  bool random = false;  ///< numbers without a scene: nothing is solved
};

/// F in one storage on one device.
struct Site {
  BenchRow base;  ///< device, scene, storage, n, columns
  const Stored* matrix = nullptr;
  SharedPlace place;
  bool asked = true;  ///< false: only there to read the dense matrix
  [[nodiscard]] bool dense() const { return matrix->storage() == Storage::dense32; }
};

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

/// One product, so that what was placed and compiled is seen to work.
void verify_place(BenchRow& row, Place& place) {
  place.scheduler().apply(place.x(), place.y());
  verify_product(row, place);
}

/// Places F a few times, keeps the last, and appends the rows "upload" and "compile", each verified by a product; or
/// the row that says why it cannot be placed.
void place(Site& site, unsigned repetitions, std::vector<BenchRow>& rows) {
  BenchRow upload = site.base, compile = site.base;
  upload.what = "upload";
  compile.what = "compile";
  CompileStatistics compiled;
  std::vector<double> seconds;
  const bool placed = guarded(upload, [&] {
    for (unsigned k = 0; k < std::min(repetitions, 3U); ++k) {
      site.place.reset();  // two copies of F may not fit
      site.place = std::make_shared<Place>(site.base.device, *site.matrix);
      seconds.push_back(site.place->upload_seconds());
      if (k > 0) continue;
      compiled = site.place->compiled();
      set_times(compile, {site.place->compile_seconds()});
    }
    verify_place(upload, *site.place);
  });
  if (!placed) site.place.reset();
  set_times(upload, placed ? seconds : std::vector<double>{});
  if (site.place != nullptr) {
    upload.bytes = site.place->scheduler().uploaded_bytes();
    upload.bytes_written = upload.bytes;
    upload.note = upload.bytes == 0 ? "in place, nothing is copied" : "";
  }
  if (site.asked || !placed) rows.push_back(upload);
  if (!site.asked || !placed || compiled.compiled + compiled.from_cache == 0) return;
  compile.error = upload.error;
  compile.bound = upload.bound;
  compile.status = upload.status;
  compile.reason = upload.reason;
  compile.note =
      std::to_string(compiled.compiled) + " compiled, " + std::to_string(compiled.from_cache) + " from the cache";
  rows.push_back(compile);
}

/// What a solve left.
struct Last {
  SolveReport report;
  std::vector<Rgb> radiosity;
  std::uint64_t launches = 0;
};

/// The largest |a − b| of all patches and channels; of |a| without b.
double largest_of(const std::vector<Rgb>& a, const std::vector<Rgb>* b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t c = 0; c < bench_channels; ++c) {
      largest = std::max(largest, std::abs(a[i][c] - (b != nullptr ? (*b)[i][c] : 0)));
    }
  }
  return largest;
}

/// The radiosities of dense32, on the first device that has it.
std::vector<Rgb> dense_radiosity(const std::vector<Site>& sites, const Loaded& room) {
  const auto dense = std::find_if(sites.begin(), sites.end(), [](const Site& site) { return site.dense(); });
  if (dense == sites.end()) return {};
  return solve_placed(dense->place->scheduler(), room.scene.mesh, Method::cg, StopTest{}).radiosity;
}

/// `reference`: of dense32, or empty.
Timed solving(const Site& site, const Loaded& room, Method method, const std::vector<Rgb>& reference) {
  const auto last = std::make_shared<Last>();
  return {.pass =
              [place = site.place, last, method, &room] {
                const std::uint64_t before = place->launches();
                Solved solved = solve_placed(place->scheduler(), room.scene.mesh, method, StopTest{});
                last->report = std::move(solved.report);
                last->radiosity = std::move(solved.radiosity);
                last->launches = place->launches() - before;
                return last->report.seconds;
              },
          .verify =
              [last, &reference, matrix = site.matrix](BenchRow& judged) {
                const SolveReport& report = last->report;
                judged.products = report.products;
                judged.launches = last->launches;
                judged.bytes = std::uint64_t{report.products} * matrix->bytes();
                judged.flops = std::uint64_t{2} * report.products * judged.columns * judged.n * judged.n;
                judged.error = *std::max_element(report.relative_residual.begin(), report.relative_residual.end());
                judged.bound = StopTest{}.tolerance;
                if (matrix->storage() != Storage::dense32 && !reference.empty()) {
                  judged.note = fmt::format("radiosity {:.1e} off dense32's",
                                            largest_of(last->radiosity, &reference) / largest_of(reference, nullptr));
                }
                if (!(judged.error <= judged.bound)) deny(judged, "not converged");
              }};
}

/// The rate at which a device reads the dense matrix of this room, in the same passes: a small one lies in the caches.
void set_ceilings(std::vector<BenchRow>& rows, const std::vector<BenchRow>& of, const std::vector<BenchRow>& measured) {
  for (BenchRow& row : rows) {
    const auto read = std::find_if(of.begin(), of.end(), [&](const BenchRow& one) {
      return one.device == row.device && one.what == "read" && one.status == "pass";
    });
    const double rate = read != of.end() ? read->gb_per_s() : device_rate(measured, row.device, "read");
    if (row.what.starts_with("solve:")) set_ceiling(row, rate, 0);
    // Of a product only y is written, which is small: by the rate of reading, or where copying is as fast, by that.
    if (row.what == "matvec" || row.what == "read" || row.what.starts_with("peer:")) set_ceiling(row, rate, rate);
  }
}

void add_room_peers(std::vector<Measurement>& all, const Site& any, const FormFactorMatrix& matrix,
                    const std::vector<peers::Peer>& peers) {
  BenchRow base = any.base;
  base.storage = std::string(name(Storage::dense32));
  add_peers(all, base, peers,
            std::make_shared<peers::Problem>(matrix, test_vector(matrix.size()), ::omp_get_max_threads()));
}

/// Read of the dense matrix and a matvec per storage on each device, in turn, and the peers between them; the ratios
/// are of the same passes.
std::vector<BenchRow> products(const std::vector<Site>& sites, const Loaded& room, unsigned repetitions,
                               const SharedPlace& machine, const std::vector<peers::Peer>& peers) {
  std::vector<Measurement> all;
  for (const Site& site : sites) {
    BenchRow row = site.base;
    if (site.dense()) {
      row.what = "read";
      row.bytes = site.matrix->bytes();
      add(all, row, [&] { return reading(site.place, room.sum); });
    }
    if (!site.asked) continue;
    row.what = "matvec";
    site.matrix->describe_product(row);
    add(all, row, [&] { return multiplying(site.place); });
  }
  if (machine != nullptr) {
    BenchRow row;
    row.device = "machine";
    row.what = "read";
    add(
        all, row, [&] { return reading(machine, room.sum); }, false);
  }
  if (!peers.empty()) add_room_peers(all, sites.front(), room.factors.matrix, peers);
  measure(all, repetitions);

  const auto cpu = [&](const std::string& id) {
    return std::any_of(sites.begin(), sites.end(), [&](const Site& site) {
      return site.base.device == id && site.place->info().type == DeviceType::cpu;
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

std::vector<BenchRow> solves(const std::vector<Site>& sites, const Loaded& room, unsigned repetitions,
                             const std::vector<BenchRow>& measured) {
  std::vector<Measurement> all;
  const bool others = std::any_of(sites.begin(), sites.end(), [](const Site& site) { return !site.dense(); });
  const std::vector<Rgb> reference = others ? dense_radiosity(sites, room) : std::vector<Rgb>{};
  for (const Site& site : sites) {
    if (!site.asked) continue;
    for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
      BenchRow row = site.base;
      row.what = "solve:" + std::string(name(method));
      add(all, row, [&] { return solving(site, room, method, reference); });
    }
  }
  measure(all, repetitions);
  std::vector<BenchRow> rows;
  rows.reserve(all.size());
  for (const Measurement& one : all) rows.push_back(one.row);
  for (BenchRow& row : rows) {
    const double launch = launch_seconds(measured, row.device);
    if (launch > 0 && row.seconds > 0) row.launch_share = static_cast<double>(row.launches) * launch / row.seconds;
  }
  return rows;
}

/// F in each storage of the plan, dense32 first and always: its reading is what the others are compared with.
std::vector<std::unique_ptr<Stored>> matrices_of(const BenchPlan& plan, const Loaded& room) {
  std::vector<std::unique_ptr<Stored>> matrices;
  const auto add = [&](Storage storage) {
    const PatchMesh& mesh = room.scene.mesh;
    matrices.push_back(room.random ? std::make_unique<Stored>(room.factors.matrix, mesh.area, storage, plan.block)
                                   : std::make_unique<Stored>(room.factors.matrix, mesh, storage, plan.block));
  };
  add(Storage::dense32);
  for (const Storage storage : plan.storages) {
    if (storage != Storage::dense32) add(storage);
  }
  return matrices;
}

std::vector<Site> sites_of(const BenchPlan& plan, const Loaded& room,
                           const std::vector<std::unique_ptr<Stored>>& matrices) {
  std::vector<Site> sites;
  for (const std::string& id : plan.devices) {
    for (const auto& matrix : matrices) {
      BenchRow base;
      base.device = id;
      base.scene = room.scene.scene.name;
      base.storage = std::string(name(matrix->storage()));
      base.n = matrix->size();
      base.columns = bench_channels;
      const bool asked =
          std::find(plan.storages.begin(), plan.storages.end(), matrix->storage()) != plan.storages.end();
      sites.push_back({base, matrix.get(), nullptr, asked});
    }
  }
  return sites;
}

std::vector<BenchRow> bench_loaded(const BenchPlan& plan, const Loaded& loaded, const std::vector<BenchRow>& measured) {
  const std::vector<std::unique_ptr<Stored>> matrices = matrices_of(plan, loaded);
  std::vector<BenchRow> rows;
  std::vector<Site> sites = sites_of(plan, loaded, matrices);
  for (Site& site : sites) place(site, plan.repetitions, rows);
  std::erase_if(sites, [](const Site& site) { return site.place == nullptr; });
  const bool any_cpu = std::any_of(sites.begin(), sites.end(),
                                   [](const Site& site) { return site.place->info().type == DeviceType::cpu; });
  const bool has_openmp = std::find(plan.devices.begin(), plan.devices.end(), "openmp") != plan.devices.end();
  // What the machine's memory gives in the same seconds: F is shared, so that it costs none.
  const SharedPlace machine =
      (any_cpu || plan.peers) && !has_openmp ? std::make_shared<Place>("openmp", *matrices.front()) : nullptr;
  const auto append = [&](std::vector<BenchRow> more) { rows.insert(rows.end(), more.begin(), more.end()); };
  const auto peers = plan.peers && !sites.empty() ? peers::all_peers(plan.devices) : std::vector<peers::Peer>{};
  append(products(sites, loaded, plan.repetitions, machine, peers));
  if (!loaded.random) append(solves(sites, loaded, std::max(1U, plan.repetitions / 3), measured));
  set_ceilings(rows, std::vector<BenchRow>(rows), measured);
  return rows;
}

/// And patches of one size.
Loaded random_matrix(std::uint32_t n) {
  Loaded loaded;
  loaded.random = true;
  loaded.scene.scene.name = "random";
  loaded.scene.mesh.area.assign(n, 1.0);
  loaded.factors.matrix = random_form_factors(n);
  for (const double row : loaded.factors.matrix.row_sums()) loaded.sum += row;
  return loaded;
}

}  // namespace

FormFactorMatrix random_form_factors(std::uint32_t n) {
  FormFactorMatrix matrix(n);
#pragma omp parallel for schedule(dynamic, 16)
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::span<float> row = matrix.row(i);
    for (std::uint32_t j = 0; j < n; ++j) {
      std::uint32_t mixed = (std::min(i, j) * 2654435761U ^ std::max(i, j) * 40503U) * 2246822519U;
      mixed ^= mixed >> 15U;
      row[j] = (0.5F + static_cast<float>(mixed >> 8U) * 0x1p-24F) / static_cast<float>(n);
    }
  }
  return matrix;
}

std::vector<BenchRow> bench_room(const BenchPlan& plan, const Room& room, const std::vector<BenchRow>& measured,
                                 ProgressSink& progress) {
  return bench_loaded(plan, load_room(plan.folder, room, progress), measured);
}

std::vector<BenchRow> bench_random(const BenchPlan& plan, std::uint32_t n, const std::vector<BenchRow>& measured) {
  return bench_loaded(plan, random_matrix(n), measured);
}

}  // namespace interflect::cli
