#include "bench_assembly.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "interflect/schedule/device_form_factors.h"
#include "measurement.h"
#include "pipeline.h"

namespace interflect::cli {

namespace {

// What a device may differ from the Embree path by, in a row sum: only rays that graze an edge do.
constexpr double device_bound = 1e-3;
// What is promised of a closed scene's row sums after the closure.
constexpr double closure_bound = 1e-4;

/// What the last pass left.
struct Last {
  AssemblyReport report;
  std::uint64_t bytes = 0;
};

void judge_row(BenchRow& row, const Last& last, const AssemblyReport& embree) {
  const AssemblyReport& report = last.report;
  row.rays = report.rays;
  row.bytes = row.what == "growth" ? last.bytes : 0;
  row.bytes_written = row.bytes;
  if (row.device == "openmp") {
    row.bound = closure_bound;
    row.error = report.closure_applied ? std::max(std::abs(report.after.min - 1), std::abs(report.after.max - 1)) : 0;
    if (report.trace_seconds > 0) row.trace_ratio = report.seconds / report.trace_seconds;
  } else {
    row.bound = device_bound;
    for (std::size_t i = 0; i < report.row_sum_before.size(); ++i) {
      row.error = std::max(row.error, std::abs(report.row_sum_before[i] - embree.row_sum_before[i]));
    }
  }
  row.note = fmt::format("{:.1f} million rays a second", static_cast<double>(report.rays) / report.seconds * 1e-6);
  if (row.trace_ratio) row.note += fmt::format(", {:.2f} times what Embree takes for them", *row.trace_ratio);
  if (!(row.error <= row.bound)) deny(row, "row sums differ");
}

Timed assembling(const std::string& id, const MeshedScene& scene, const AssemblyOptions& options,
                 const std::shared_ptr<Last>& embree) {
  const auto last = id == "openmp" ? embree : std::make_shared<Last>();
  const auto pass = [id, last, &scene, &options] {
    last->report = assembly_on(id, scene.mesh, options);
    last->bytes = FormFactorMatrix::predicted_bytes(scene.mesh.size());
    return last->report.seconds;
  };
  return {.pass = pass, .verify = [last, embree](BenchRow& row) { judge_row(row, *last, embree->report); }};
}

}  // namespace

AssemblyReport assembly_on(const std::string& id, const PatchMesh& mesh, const AssemblyOptions& options) {
  if (id == "openmp") return assemble(mesh, options).report;
  return DeviceFormFactors(open_device(id), mesh, options).report();
}

std::vector<BenchRow> bench_assembly(const AssemblyPlan& plan, const SceneOptions& scene_options,
                                     const std::string& label, ProgressSink& progress) {
  BenchRow base;
  base.what = plan.growth ? "growth" : "assembly";
  base.scene = label.empty() ? std::filesystem::path(scene_options.file).stem().string() : label;
  base.storage = plan.growth ? "assembly" : "";
  base.n = static_cast<std::uint32_t>(scene_options.patches.value_or(0));
  MeshedScene scene;
  const bool loaded = guarded(base, [&] { scene = load(scene_options, progress); });
  if (loaded) base.n = static_cast<std::uint32_t>(scene.mesh.size());

  // The Embree path takes part in any case: the others are held against it.
  std::vector<std::string> devices = plan.devices;
  const bool asked = std::find(devices.begin(), devices.end(), "openmp") != devices.end();
  if (!asked) devices.insert(devices.begin(), "openmp");
  const auto embree = std::make_shared<Last>();
  std::vector<Measurement> all;
  for (const std::string& id : devices) {
    BenchRow row = base;
    row.device = id;
    add(
        all, row,
        [&] {
          if (!loaded) throw Error(ErrorKind::limit, base.reason);
          return assembling(id, scene, plan.options, embree);
        },
        asked || id != "openmp");
  }
  measure(all, plan.repetitions);
  std::vector<BenchRow> rows;
  const Measurement* host = find(all, "openmp", base.what);
  for (Measurement& one : all) {
    if (host != nullptr && one.row.device != "openmp" && one.row.status == "pass") {
      one.row.embree_ratio = median_ratio(*host, one);
      one.row.note += fmt::format(", {:.2f} of the Embree path's speed", *one.row.embree_ratio);
    }
    if (one.shown) rows.push_back(one.row);
  }
  return rows;
}

}  // namespace interflect::cli
