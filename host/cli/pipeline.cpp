#include "pipeline.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/schedule/storage_choice.h"
#include "interflect/solver/batches.h"
#include "interflect/solver/rounding.h"
#include "launch.h"
#include "tune.h"
#include "validators.h"

namespace interflect::cli {

void add_scene_options(CLI::App& command, SceneOptions& options, const std::string& what) {
  command.add_option("SCENE", options.file, what)->required();
  auto* divide = command
                     .add_option("--divide", options.divide,
                                 "split triangles into four until their area is at most this (default: as many "
                                 "patches as come nearest to 5000)")
                     ->check(number(0.0));
  command.add_option("--patches", options.patches, "choose the area whose patch count comes nearest to this")
      ->check(number<std::uint64_t>(0))
      ->excludes(divide);
  command.add_flag("--two-sided", options.two_sided, "a patch on each side of every triangle");
  command.add_option("--closure", options.closure, "scale row sums to 1: auto (closed scenes), on, off")
      ->check(CLI::IsMember({"auto", "on", "off"}));
  command.add_option("--group-by", options.group_by, "what the groups are: auto, object, group, material")
      ->check(CLI::IsMember({"auto", "object", "group", "material"}));
  command.add_option("--accuracy", options.accuracy,
                     "low, medium, high, or the rms error of a row sum that sampling may leave (default: medium)");
  command.add_option("--seed", options.seed, "of the visibility samples (default: 1)")->check(whole_number());
  command
      .add_option("--memory", options.memory,
                  "what the form factors may take, such as 4G (default: what is available, less a reserve); what "
                  "exceeds it stays in the .iff file and is read for every product")
      ->check(byte_size());
  command.add_flag("--quiet", options.quiet, "no progress, no warnings; solve: no summary either");
  command.add_flag("--json-progress", options.json_progress,
                   "progress for programs: one JSON object per line on stderr (docs/progress.md)");
}

Voice voice_of(const SceneOptions& options) {
  if (!speaks()) return Voice::quiet;
  return options.json_progress ? Voice::json : options.quiet ? Voice::quiet : Voice::people;
}

GroupBy group_by(const std::string& name) {
  static const std::map<std::string, GroupBy> names{{"auto", GroupBy::automatic},
                                                    {"object", GroupBy::object},
                                                    {"group", GroupBy::group},
                                                    {"material", GroupBy::material}};
  return names.at(name);
}

namespace {

constexpr std::uint64_t default_patches = 5000;

/// The line with the scene's name in front, if it does not name a place in it already.
std::string with_file(const Scene& scene, const std::string& line) {
  return line.starts_with(scene.file + ":") ? line : fmt::format("{}: {}", scene.file, line);
}

std::vector<std::string> report_findings(const Scene& scene, bool two_sided, ProgressSink& progress) {
  std::vector<std::string> warnings = scene.warnings;
  for (const std::string& warning : warnings) progress.message("warning: " + warning);
  for (const Finding& finding : check_scene(scene, two_sided)) {
    const std::string line = with_file(scene, finding.line());
    if (finding.severity == Finding::Severity::error) throw Error(ErrorKind::input, line);
    progress.message("warning: " + line);
    warnings.push_back(line);
  }
  return warnings;
}

}  // namespace

MeshedScene load(const SceneOptions& options, ProgressSink& progress) {
  MeshedScene loaded;
  Timer timer;
  progress.begin("Read", 0);
  loaded.scene = read_scene(options.file);
  progress.end();
  loaded.warnings = report_findings(loaded.scene, options.two_sided, progress);
  loaded.read_seconds = timer.seconds();

  timer.restart();
  progress.begin("Mesh", 0);
  SubdivideOptions subdivision;
  subdivision.two_sided = options.two_sided;
  subdivision.divide = options.divide
                           ? *options.divide
                           : choose_divide(loaded.scene, options.patches.value_or(default_patches), options.two_sided);
  loaded.divide = subdivision.divide;
  loaded.mesh = subdivide(loaded.scene, subdivision);
  loaded.grouping = group_surfaces(loaded.scene, group_by(options.group_by));
  loaded.mesh_seconds = timer.seconds();
  progress.end();
  return loaded;
}

Accuracy accuracy_asked(const SceneOptions& options) {
  return options.accuracy ? accuracy_of(*options.accuracy) : Accuracy{};
}

AssemblyOptions assembly_options(const SceneOptions& options) {
  AssemblyOptions assembly;
  assembly.closure = options.closure == "on"    ? Closure::on
                     : options.closure == "off" ? Closure::off
                                                : Closure::automatic;
  assembly.budget = budget_of(accuracy_asked(options));
  assembly.seed = options.seed.value_or(assembly.seed);
  return assembly;
}

void report_warnings(const AssemblyReport& report, const std::string& name, ProgressSink& progress) {
  for (const std::string& warning : report.warnings) {
    progress.message(fmt::format("warning: {}: {}", name, warning));
  }
}

std::optional<std::uint64_t> memory_for_streaming(const SceneOptions& options, std::size_t patches) {
  if (options.memory) {
    const std::uint64_t memory = parse_bytes(*options.memory, "--memory");
    return FormFactorMatrix::predicted_bytes(patches) <= memory ? std::nullopt : std::optional(memory);
  }
  const std::uint64_t available = available_memory(), needed = assembly_memory(patches);
  if (needed <= available) return std::nullopt;
  const std::uint64_t beside = needed - FormFactorMatrix::predicted_bytes(patches);
  return available > beside ? (available - beside) / 8 * 7 : 0;
}

void check_memory_asked(const SceneOptions& options, std::size_t patches, const std::string& how_to_keep) {
  if (!options.memory || !memory_for_streaming(options, patches)) return;
  constexpr double mebibyte = 1 << 20;
  throw Error(
      ErrorKind::limit,
      fmt::format("the form factors of {} patches need {:.1f} MiB, and --memory allows {}; keep them in a file, "
                  "from where they are read for every product: {}",
                  patches, static_cast<double>(FormFactorMatrix::predicted_bytes(patches)) / mebibyte, *options.memory,
                  how_to_keep));
}

FormFactors assemble_checked(const MeshedScene& loaded, const SceneOptions& options, ProgressSink& progress) {
  FormFactors factors = assemble(loaded.mesh, assembly_options(options), &progress);
  report_warnings(factors.report, loaded.scene.file, progress);
  return factors;
}

PackedMatrix pack(const FormFactorMatrix& matrix, const PatchMesh& mesh, Storage storage, std::uint32_t block) {
  PackedMatrix::Options options;
  options.block = block;
  if (storage != Storage::dense16) options.order = patch_order(mesh, matrix);
  return {matrix, mesh.area, storage, std::move(options)};
}

std::uint32_t columns_of_packed(const PackedMatrix& packed, const DeviceInfo& device, std::size_t columns) {
  constexpr std::uint32_t channels = 3;
  std::uint32_t at_once = columns_at_once(columns);
  if (packed.storage() != Storage::sym16) return at_once;
  const std::uint64_t of_a_column =
      std::uint64_t{packed.block_rows()} * packed.block_rows() * packed.block() * sizeof(float);
  const auto too_large = [&](std::uint64_t bytes) {
    return (device.max_buffer_bytes != 0 && bytes > device.max_buffer_bytes) ||
           (device.memory_bytes != 0 && bytes > device.memory_bytes / 4);
  };
  while (at_once > channels && too_large(at_once * of_a_column)) at_once -= channels;
  return at_once;
}

Solved solved_of(FallbackReport done, const PatchMesh& mesh, const Lamps& lamps, const Columns& radiosity,
                 StorageUse storage) {
  LitPatches lit = lit_patches(radiosity, lamps.groups);
  Solved solved{std::move(lit.all),  std::move(done.report), std::move(done.devices), std::move(done.failures),
                done.upload_seconds, std::move(storage),     done.uploaded_bytes};
  solved.lights = lamps.groups;
  solved.lit = std::move(lit.by_group);
  solved.shares = std::move(done.shares);
  solved.lost = std::move(done.lost);
  solved.groups = group_residuals(mesh, lamps.groups, solved.report.relative_residual);
  solved.report.relative_residual = worst_of_groups(solved.report.relative_residual);
  return solved;
}

namespace {

std::vector<DeviceInfo> infos_of(const std::vector<Device*>& devices) {
  std::vector<DeviceInfo> infos;
  for (const Device* device : devices) infos.push_back(device->info());
  return infos;
}

using Bounces = std::vector<std::vector<std::vector<Rgb>>>;

Solved solve_dense(const FormFactorMatrix& matrix, const PatchMesh& mesh, Candidates& candidates, Method method,
                   const StopTest& stop, ProgressSink& progress, const Lamps& lamps) {
  const Light light = light_of(mesh, lamps.groups);
  Columns radiosity;
  Bounces bounces;
  FallbackReport done = solve_on(
      candidates, matrix, method, stop, mesh.area, light.reflectance, light.emittance, radiosity, &progress, 1.0,
      [&](Scheduler& scheduler) {
        if (lamps.bounces) bounces = bounces_of(scheduler, light, *lamps.bounces, &progress);
      },
      LastFails::gives_up);
  Solved solved =
      solved_of(std::move(done), mesh, lamps, radiosity, {Storage::dense32, matrix.bytes(), matrix.nonzero_fraction()});
  solved.bounces = std::move(bounces);
  return solved;
}

Solved solve_packed(const FormFactorMatrix& matrix, const PatchMesh& mesh, Candidates& candidates, Storage storage,
                    Method method, const StopTest& stop, ProgressSink& progress, const Lamps& lamps) {
  const Timer packing;
  const PackedMatrix packed = pack(matrix, mesh, storage, sym16_block(candidates.info(), matrix.size()));
  StorageUse use{storage, packed.bytes(), packed.nonzero_fraction(), {}, packing.seconds()};
  const Light light = light_of(mesh, lamps.groups);
  const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
    std::uint32_t columns = most_columns;
    for (const auto& device : devices) {
      columns = std::min(columns, columns_of_packed(packed, device->info(), light.emittance.size()));
    }
    return std::make_unique<Scheduler>(packed, std::move(devices), columns, candidates.split());
  };
  Columns radiosity;
  Bounces bounces;
  const auto after = [&](Scheduler& scheduler) {
    if (progress.interrupted()) return;
    if (lamps.bounces) bounces = bounces_of(scheduler, light, *lamps.bounces, &progress);
    // A fixed number of iterations asks for that many bounces, not for a solution that could be judged.
    if (stop.iterations) return;
    use.rounding_error =
        rounding_error(scheduler, method, matrix, mesh.area, light.reflectance, light.emittance, radiosity);
  };
  FallbackReport done = solve_on(candidates, place, method, stop, mesh.area, light.reflectance, light.emittance,
                                 radiosity, &progress, 1.0, after, LastFails::gives_up);
  Solved solved = solved_of(std::move(done), mesh, lamps, radiosity, use);
  solved.bounces = std::move(bounces);
  return solved;
}

}  // namespace

Solved solve_scene(const FormFactorMatrix& matrix, const PatchMesh& mesh, Candidates& candidates,
                   std::optional<Storage> storage, Method method, const StopTest& stop, ProgressSink& progress,
                   const Lamps& lamps) {
  const std::vector<Device*> devices = candidates.devices();
  const Storage format = storage ? *storage : choose_storage(matrix.size(), infos_of(devices));
  for (Device* device : devices) tune_on_first_use(*device, format, matrix.size(), progress);
  if (format == Storage::dense32) return solve_dense(matrix, mesh, candidates, method, stop, progress, lamps);
  Solved solved = solve_packed(matrix, mesh, candidates, format, method, stop, progress, lamps);
  const std::optional<double> error = solved.storage.rounding_error;
  std::string why;
  if (solved.report.interrupted || solved.lost) return solved;
  if (!solved.report.converged && !stop.iterations && solved.report.iterations < stop.max_iterations) {
    why = "the rounded form factors have no solution within the tolerance";  // where ρ is near 1 they may have none at
                                                                             // all
  } else if (error && solved.report.converged && !(*error <= largest_rounding_error)) {  // also NaN
    why = fmt::format("its rounding moves a radiosity by {:.2e} of the largest, {:.0e} is allowed", *error,
                      largest_rounding_error);
  }
  if (why.empty()) return solved;
  progress.message(fmt::format("warning: {} is refused: {}; solving with dense32", name(format), why));
  Solved dense = solve_dense(matrix, mesh, candidates, method, stop, progress, lamps);
  dense.storage.refused = fmt::format("{}: {}", name(format), why);
  dense.storage.pack_seconds = solved.storage.pack_seconds;
  dense.uploaded_bytes += solved.uploaded_bytes;
  return dense;
}

Solved solve_streamed(const StreamedMatrix& matrix, const PatchMesh& mesh, Candidates& candidates,
                      std::optional<Storage> storage, Method method, const StopTest& stop, ProgressSink& progress,
                      const Lamps& lamps) {
  if (storage && *storage != Storage::dense32) {
    throw Error(ErrorKind::limit,
                fmt::format("--storage {} is packed from all form factors at once, and they do not fit the memory: use "
                            "--storage dense32, or a larger --memory",
                            name(*storage)));
  }
  tune_on_first_use(candidates.device(), Storage::dense32, matrix.size(), progress);
  const Light light = light_of(mesh, lamps.groups);
  if (candidates.at_once() > 1) {
    progress.message(
        fmt::format("the form factors stay in a file and are read for one device, {}: the others come in "
                    "when it fails",
                    candidates.info().id));
  }
  const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
    devices.resize(1);
    return std::make_unique<Scheduler>(matrix, std::move(devices), columns_at_once(light.emittance.size()));
  };
  Columns radiosity;
  Bounces bounces;
  FallbackReport done = solve_on(
      candidates, place, method, stop, mesh.area, light.reflectance, light.emittance, radiosity, &progress, 1.0,
      [&](Scheduler& scheduler) {
        if (lamps.bounces) bounces = bounces_of(scheduler, light, *lamps.bounces, &progress);
      },
      LastFails::gives_up);
  StorageUse use{Storage::dense32, matrix.bytes()};
  const PanelStream& stream = matrix.stream();
  use.streamed = {stream.panels().panels(), stream.resident(), stream.use().bytes_read, stream.use().passes,
                  stream.use().seconds_waiting};
  Solved solved = solved_of(std::move(done), mesh, lamps, radiosity, use);
  solved.bounces = std::move(bounces);
  return solved;
}

Solved solve_placed(Scheduler& scheduler, const PatchMesh& mesh, Method method, const StopTest& stop,
                    const Lamps& lamps) {
  const Light light = light_of(mesh, lamps.groups);
  BatchedSolve batches(method, stop, mesh.area, light.reflectance, light.emittance);
  batches.run(scheduler);
  FallbackReport done;
  done.report = batches.report();
  done.devices = scheduler.device_ids();
  StorageUse use;
  use.format = scheduler.storage();
  use.bytes = scheduler.bytes();
  Solved solved = solved_of(std::move(done), mesh, lamps, batches.radiosity(), std::move(use));
  if (lamps.bounces) solved.bounces = bounces_of(scheduler, light, *lamps.bounces, nullptr);
  return solved;
}

double Energy::balance_error() const {
  double sum = 0, difference = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    sum += emitted[c];
    difference += std::abs(emitted[c] - absorbed[c] - escaped[c]);
  }
  return sum > 0 ? difference / sum : 0;
}

Energy energy_balance(const ExactProduct& exact, const PatchMesh& mesh, const std::vector<Rgb>& radiosity,
                      const std::vector<double>& row_sum) {
  const auto n = static_cast<std::uint32_t>(mesh.size());
  Columns b(3, std::vector<float>(n));  // the radiosities came as floats: nothing is lost
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < 3; ++c) b[c][i] = static_cast<float>(radiosity[i][c]);
  }
  std::vector<std::vector<double>> received;
  exact(b, received);
  Energy energy;
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      energy.emitted[c] += mesh.area[i] * mesh.emittance[i][c];
      energy.absorbed[c] += mesh.area[i] * (1 - mesh.reflectance[i][c]) * received[c][i];
      energy.escaped[c] += mesh.area[i] * radiosity[i][c] * (1 - row_sum[i]);
    }
  }
  return energy;
}

}  // namespace interflect::cli
