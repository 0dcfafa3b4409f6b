#include "place.h"

#include <fmt/format.h>

#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/schedule/device_form_factors.h"
#include "interflect/schedule/storage_choice.h"
#include "tune.h"

namespace interflect::cli {

namespace {

constexpr const char* keep_in_a_file = "--form-factors FILE.iff";

/// Whether F is assembled on this device and stays there.
bool resides(AssemblyPlace place, const DeviceInfo& device, std::uint32_t n) {
  // What has no room is an Error where the device was asked for.
  return assembles(place, device) && (place == AssemblyPlace::device || choose_storage(n, device) == Storage::dense32);
}

/// Places F on one device after the other, where each assembles it or, once for all, the host has.
class Placing {
 public:
  Placing(const MeshedScene& loaded, const SceneOptions& options, AssemblyPlace place, std::uint32_t columns,
          PlacedSolve& out, ProgressSink& progress)
      : loaded_(loaded), options_(options), place_(place), columns_(columns), out_(out), progress_(progress) {}

  [[nodiscard]] std::unique_ptr<Scheduler> place(std::vector<std::unique_ptr<Device>> devices) {
    const auto n = static_cast<std::uint32_t>(loaded_.mesh.size());
    if (devices.size() == 1 && resides(place_, devices.front()->info(), n))
      return on_device(std::move(devices.front()));
    return on_host(std::move(devices));
  }
  /// Of assembling, on the devices that failed too.
  [[nodiscard]] double seconds() const { return seconds_; }
  [[nodiscard]] const StorageUse& storage() const { return storage_; }

 private:
  std::unique_ptr<Scheduler> on_device(std::unique_ptr<Device> device) {
    const Timer timer;
    const std::string id = device->info().id;
    DeviceFormFactors factors(std::move(device), loaded_.mesh, assembly_options(options_), &progress_);
    seconds_ += timer.seconds();
    out_.factors = {{}, factors.report()};
    out_.assembly = {id, out_.assembly.bytes_over_bus};
    storage_ = {Storage::dense32, factors.matrix().bytes(), factors.nonzero_fraction()};
    report_warnings(out_.factors.report, loaded_.scene.file, progress_);
    return std::make_unique<Scheduler>(std::move(factors), columns_);
  }
  std::unique_ptr<Scheduler> on_host(std::vector<std::unique_ptr<Device>> devices) {
    if (out_.factors.matrix.size() == 0) {
      const Timer timer;
      out_.factors = assemble_checked(loaded_, options_, progress_);
      seconds_ += timer.seconds();
      out_.assembly.device = AssemblyUse{}.device;
      storage_ = {Storage::dense32, out_.factors.matrix.bytes(), out_.factors.matrix.nonzero_fraction()};
    }
    auto scheduler = std::make_unique<Scheduler>(out_.factors.matrix, std::move(devices), columns_);
    out_.assembly.bytes_over_bus += scheduler->uploaded_bytes();
    return scheduler;
  }

  const MeshedScene& loaded_;
  const SceneOptions& options_;
  AssemblyPlace place_;
  std::uint32_t columns_;
  PlacedSolve& out_;
  ProgressSink& progress_;
  double seconds_ = 0;
  StorageUse storage_;
};

void solve_where_assembled(const MeshedScene& loaded, const SceneOptions& options, AssemblyPlace place,
                           Candidates& candidates, Method method, const StopTest& stop, ProgressSink& progress,
                           const Lamps& lamps, PlacedSolve& out) {
  const PatchMesh& mesh = loaded.mesh;
  tune_on_first_use(candidates.device(), Storage::dense32, static_cast<std::uint32_t>(mesh.size()), progress);
  const Light light = light_of(mesh, lamps.groups);
  Placing placing(loaded, options, place, columns_at_once(light.emittance.size()), out, progress);
  Columns radiosity;
  std::vector<std::vector<double>> received;  // F b, as long as F is there
  std::vector<std::vector<std::vector<Rgb>>> bounces;
  const auto after = [&](Scheduler& scheduler) {
    if (lamps.bounces) bounces = bounces_of(scheduler, light, *lamps.bounces, &progress);
    const Columns sum = sum_of_groups(radiosity);
    scheduler.use_columns(static_cast<std::uint32_t>(sum.size()));
    scheduler.exact_product(sum, received);
  };
  FallbackReport done = solve_on(
      candidates, [&](auto devices) { return placing.place(std::move(devices)); }, method, stop, mesh.area,
      light.reflectance, light.emittance, radiosity, &progress, 1.0, after);
  done.upload_seconds = std::max(0.0, done.upload_seconds - placing.seconds());
  out.solved = solved_of(std::move(done), mesh, lamps, radiosity, placing.storage());
  out.solved.bounces = std::move(bounces);
  out.energy = energy_balance([&](const Columns&, auto& y) { y = received; }, mesh, out.solved.radiosity,
                              out.factors.report.row_sum);
}

}  // namespace

Solution solution_of(const MeshedScene& loaded, const PlacedSolve& placed) {
  Solution solution{&loaded.mesh, loaded.grouping, placed.solved.radiosity, placed.factors.report.row_sum};
  solution.lights = placed.solved.lights;
  solution.lit = placed.solved.lit;
  solution.bounces = placed.solved.bounces;
  return solution;
}

PlacedSolve assemble_and_solve(const MeshedScene& loaded, const SceneOptions& options, Assembler& assembler,
                               std::optional<Storage> storage, Method method, const StopTest& stop,
                               ProgressSink& progress, const Lamps& lamps) {
  PlacedSolve out;
  const PatchMesh& mesh = loaded.mesh;
  const auto n = static_cast<std::uint32_t>(mesh.size());
  check_memory_asked(options, n, keep_in_a_file);
  const AssemblyPlace place = assembler.place();
  Candidates& candidates = assembler.candidates();
  // Asked for the device, `auto` does not turn to a smaller format: that would be packed on the host.
  const bool dense = storage
                         ? *storage == Storage::dense32
                         : place == AssemblyPlace::device || choose_storage(n, candidates.info()) == Storage::dense32;
  // What several devices share goes through the host.
  if (dense && candidates.at_once() == 1 && resides(place, candidates.info(), n)) {
    solve_where_assembled(loaded, options, place, candidates, method, stop, progress, lamps, out);
    return out;
  }
  out.factors = assemble_in_memory(loaded, options, keep_in_a_file, assembler, progress);
  out.assembly = assembler.use();
  if (out.assembly.bytes_over_bus > 0) {
    progress.message(fmt::format("the form factors came from {} to be stored on the host", out.assembly.device));
  }
  out.solved = solve_scene(out.factors.matrix, mesh, candidates, storage, method, stop, progress, lamps);
  out.assembly.bytes_over_bus += out.solved.uploaded_bytes;
  const auto product = [&](const Columns& x, auto& y) { exact_product(out.factors.matrix, x, y); };
  out.energy = energy_balance(product, mesh, out.solved.radiosity, out.factors.report.row_sum);
  return out;
}

PlacedSolve solve_kept(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                       Assembler& assembler, std::optional<Storage> storage, Method method, const StopTest& stop,
                       ProgressSink& progress, const Lamps& lamps) {
  KeptFormFactors kept = form_factors_for_solve(file, loaded, options, assembler, progress);
  PlacedSolve out;
  out.assembly = assembler.use();
  out.kept = std::move(kept.kept);
  out.factors = std::move(kept.factors);
  std::optional<StreamedMatrix> streamed;
  if (kept.panels != nullptr) {
    streamed.emplace(*kept.panels, loaded.mesh.area, out.factors.report.scaling, kept.memory);
  }
  Candidates& candidates = assembler.candidates();
  const FormFactorMatrix& matrix = out.factors.matrix;
  out.solved = streamed ? solve_streamed(*streamed, loaded.mesh, candidates, storage, method, stop, progress, lamps)
                        : solve_scene(matrix, loaded.mesh, candidates, storage, method, stop, progress, lamps);
  if (streamed) out.solved.storage.nonzero_fraction = kept.panels->nonzero_fraction();
  out.assembly.bytes_over_bus += out.solved.uploaded_bytes;
  const ExactProduct exact = [&](const Columns& x, std::vector<std::vector<double>>& y) {
    streamed ? exact_product(*streamed, x, y) : exact_product(matrix, x, y);
  };
  out.energy = energy_balance(exact, loaded.mesh, out.solved.radiosity, out.factors.report.row_sum);
  return out;
}

}  // namespace interflect::cli
