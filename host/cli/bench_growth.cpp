#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "bench_place.h"
#include "bench_rows.h"
#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "measurement.h"
#include "pipeline.h"

namespace interflect::cli {

namespace {

constexpr std::uint32_t first_size = 1000, sizes = 6;  // 1k to 32k
constexpr const char* family = "room-1312.obj";

/// Large sizes spread less and cost more.
unsigned repetitions_for(std::uint32_t n, unsigned asked) {
  const std::uint32_t few = std::max(3U, asked * 4096 / std::max(n, 1U));
  return std::min(asked, few);
}

/// Throws a limit Error when the dense matrix, from which every storage is made, does not fit.
void check_memory(std::uint32_t n) {
  const std::uint64_t needed = FormFactorMatrix::predicted_bytes(n), available = available_memory();
  if (needed <= available) return;
  const auto gib = [](std::uint64_t bytes) { return static_cast<double>(bytes) / static_cast<double>(1U << 30); };
  throw Error(ErrorKind::limit, fmt::format("F takes {:.2f} GiB, {:.2f} may be used", gib(needed), gib(available)));
}

/// One storage on every device in turn.
void append_rows(std::vector<BenchRow>& rows, const BenchPlan& plan, const Stored& matrix, const BenchRow& base) {
  std::vector<Measurement> all;
  for (const std::string& id : plan.devices) {
    BenchRow row = base;
    row.device = id;
    matrix.describe_product(row);
    add(all, row, [&] { return multiplying(std::make_shared<Place>(id, matrix)); });
  }
  measure(all, repetitions_for(base.n, plan.repetitions));
  for (const Measurement& one : all) rows.push_back(one.row);
}

/// A row for every device that says why there is none.
void append_refused(std::vector<BenchRow>& rows, const BenchPlan& plan, const BenchRow& why, Storage storage) {
  for (const std::string& id : plan.devices) {
    rows.push_back(why);
    rows.back().device = id;
    rows.back().storage = std::string(name(storage));
  }
}

std::vector<BenchRow> step(const BenchPlan& plan, std::uint32_t patches, ProgressSink& progress) {
  SceneOptions options;
  options.file = (std::filesystem::path(plan.folder) / family).string();
  options.patches = patches;
  BenchRow base;
  base.what = "growth";
  base.columns = bench_channels;
  base.n = patches;
  base.scene = std::filesystem::path(family).stem().string();
  std::vector<BenchRow> rows;
  MeshedScene scene;
  FormFactors factors;
  const bool loaded = guarded(base, [&] {
    scene = load(options, progress);
    base.n = static_cast<std::uint32_t>(scene.mesh.size());
    check_memory(base.n);
    factors = assemble_checked(scene, options, progress);
  });
  for (const Storage storage : plan.storages) {
    BenchRow why = base;
    const bool measured = loaded && guarded(why, [&] {
                            const Stored matrix(factors.matrix, scene.mesh, storage, plan.block);
                            append_rows(rows, plan, matrix, base);
                          });
    if (!measured) append_refused(rows, plan, why, storage);
  }
  return rows;
}

}  // namespace

void bench_growth(const BenchPlan& plan, std::uint32_t most, const std::vector<BenchRow>& measured,
                  ProgressSink& progress, const RowSink& sink) {
  for (std::uint32_t k = 0; k < sizes; ++k) {
    const std::uint32_t patches = first_size << k;
    if (patches > most) return;
    std::vector<BenchRow> rows = step(plan, patches, progress);
    for (BenchRow& row : rows) {
      const double rate = device_rate(measured, row.device, "read");
      set_ceiling(row, rate, rate);
    }
    sink(rows);
  }
}

}  // namespace interflect::cli
