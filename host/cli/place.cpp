#include "place.h"

#include <fmt/format.h>

#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/compile_cache.h"
#include "interflect/schedule/device_form_factors.h"
#include "interflect/schedule/device_tile_maker.h"
#include "interflect/schedule/storage_choice.h"
#include "tune.h"

namespace interflect::cli {

void add_assembly_option(CLI::App& command, std::string& text) {
  command
      .add_option(
          "--assembly", text,
          "where the form factors are computed: host; device (OpenMP's is the host); auto: on a GPU, else on the "
          "host")
      ->check(CLI::IsMember({"auto", "host", "device"}))
      ->capture_default_str();
}

AssemblyPlace assembly_place(const std::string& text) {
  return text == "host" ? AssemblyPlace::host : text == "device" ? AssemblyPlace::device : AssemblyPlace::automatic;
}

bool assembles(AssemblyPlace place, const DeviceInfo& device) {
  if (place == AssemblyPlace::host || device.backend == "openmp") return false;
  return place == AssemblyPlace::device || device.type != DeviceType::cpu;  // there Embree does it faster
}

void say(const AssemblyReport& report, const Scene& scene, ProgressSink& progress) {
  for (const std::string& warning : report.warnings) {
    progress.message(fmt::format("warning: {}: {}", scene.file, warning));
  }
}

FormFactors assemble_by(Candidates& candidates, AssemblyPlace place, const PatchMesh& mesh, AssemblyOptions options,
                        AssemblyUse& use, ProgressSink& progress) {
  while (assembles(place, candidates.info())) {
    try {
      Device& device = candidates.device();
      options.maker = [&](const PatchTable& patches, const Blockers& blockers) {
        return std::make_unique<DeviceTileMaker>(device, patches, blockers, options.budget, options.seed);
      };
      const double compiled_before = compile_statistics().seconds;
      FormFactors factors = assemble(mesh, options, &progress);
      factors.report.seconds -= compile_statistics().seconds - compiled_before;
      use = {candidates.id(), factors.matrix.bytes()};
      return factors;
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::device) throw;  // also the host's limits, which no device can help with
      candidates.take().reset();
      candidates.give_up(error);
    }
  }
  options.maker = {};
  use = {};
  return assemble(mesh, options, &progress);
}

namespace {

constexpr std::uint32_t channels = 3;

/// Whether F is assembled on this device and stays there.
bool resides(AssemblyPlace place, const DeviceInfo& device, std::uint32_t n) {
  // What has no room is an Error where the device was asked for.
  return assembles(place, device) && (place == AssemblyPlace::device || choose_storage(n, device) == Storage::dense32);
}

/// Places F on one device after the other, where each assembles it or, once for all, the host has.
class Placing {
 public:
  Placing(const MeshedScene& loaded, const AssemblyOptions& options, AssemblyPlace place, PlacedSolve& out,
          ProgressSink& progress)
      : loaded_(loaded), options_(options), place_(place), out_(out), progress_(progress) {}

  [[nodiscard]] std::unique_ptr<Scheduler> place(std::unique_ptr<Device> device) {
    const auto n = static_cast<std::uint32_t>(loaded_.mesh.size());
    if (resides(place_, device->info(), n)) return on_device(std::move(device));
    return on_host(std::move(device));
  }
  /// Of assembling, on the devices that failed too.
  [[nodiscard]] double seconds() const { return seconds_; }
  [[nodiscard]] const StorageUse& storage() const { return storage_; }

 private:
  std::unique_ptr<Scheduler> on_device(std::unique_ptr<Device> device) {
    const Timer timer;
    const std::string id = device->info().id;
    DeviceFormFactors factors(std::move(device), loaded_.mesh, options_, &progress_);
    seconds_ += timer.seconds();
    out_.factors = {{}, factors.report()};
    out_.assembly = {id, out_.assembly.bytes_over_bus};
    storage_ = {Storage::dense32, factors.matrix().bytes(), factors.nonzero_fraction()};
    say(out_.factors.report, loaded_.scene, progress_);
    return std::make_unique<Scheduler>(std::move(factors), channels);
  }
  std::unique_ptr<Scheduler> on_host(std::unique_ptr<Device> device) {
    if (out_.factors.matrix.size() == 0) {
      const Timer timer;
      out_.factors = assemble(loaded_.mesh, options_, &progress_);
      seconds_ += timer.seconds();
      out_.assembly.device = AssemblyUse{}.device;
      storage_ = {Storage::dense32, out_.factors.matrix.bytes(), out_.factors.matrix.nonzero_fraction()};
      say(out_.factors.report, loaded_.scene, progress_);
    }
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(std::move(device));
    auto scheduler = std::make_unique<Scheduler>(out_.factors.matrix, std::move(devices), channels);
    out_.assembly.bytes_over_bus += scheduler->uploaded_bytes();
    return scheduler;
  }

  const MeshedScene& loaded_;
  const AssemblyOptions& options_;
  AssemblyPlace place_;
  PlacedSolve& out_;
  ProgressSink& progress_;
  double seconds_ = 0;
  StorageUse storage_;
};

void solve_where_assembled(const MeshedScene& loaded, const AssemblyOptions& options, AssemblyPlace place,
                           Candidates& candidates, Method method, const StopTest& stop, ProgressSink& progress,
                           PlacedSolve& out) {
  const PatchMesh& mesh = loaded.mesh;
  tune_on_first_use(candidates.device(), Storage::dense32, static_cast<std::uint32_t>(mesh.size()), progress);
  Placing placing(loaded, options, place, out, progress);
  const Light light = light_of(mesh);
  Columns radiosity;
  std::vector<std::vector<double>> received;  // F b, as long as F is there
  FallbackReport done = solve_on(
      candidates, [&](std::unique_ptr<Device> device) { return placing.place(std::move(device)); }, method, stop,
      mesh.area, light.reflectance, light.emittance, radiosity, &progress, 1.0,
      [&](Scheduler& scheduler) { scheduler.exact_product(radiosity, received); });
  done.upload_seconds = std::max(0.0, done.upload_seconds - placing.seconds());
  out.solved = solved_of(std::move(done), radiosity, placing.storage());
  out.energy = energy_balance([&](const Columns&, auto& y) { y = received; }, mesh, out.solved.radiosity,
                              out.factors.report.row_sum);
}

}  // namespace

PlacedSolve assemble_and_solve(const MeshedScene& loaded, const SceneOptions& options, AssemblyPlace place,
                               Candidates& candidates, std::optional<Storage> storage, Method method,
                               const StopTest& stop, ProgressSink& progress) {
  PlacedSolve out;
  const PatchMesh& mesh = loaded.mesh;
  const auto n = static_cast<std::uint32_t>(mesh.size());
  const AssemblyOptions assembly = assembly_options(options);
  // Asked for the device, `auto` does not turn to a smaller format: that would be packed on the host.
  const bool dense = storage
                         ? *storage == Storage::dense32
                         : place == AssemblyPlace::device || choose_storage(n, candidates.info()) == Storage::dense32;
  if (dense && resides(place, candidates.info(), n)) {
    solve_where_assembled(loaded, assembly, place, candidates, method, stop, progress, out);
    return out;
  }
  out.factors = assemble_by(candidates, place, mesh, assembly, out.assembly, progress);
  say(out.factors.report, loaded.scene, progress);
  if (out.assembly.bytes_over_bus > 0) {
    progress.message(fmt::format("the form factors came from {} to be stored on the host", out.assembly.device));
  }
  out.solved = solve_scene(out.factors.matrix, mesh, candidates, storage, method, stop, progress);
  out.assembly.bytes_over_bus += out.solved.uploaded_bytes;
  const auto product = [&](const Columns& x, auto& y) { exact_product(out.factors.matrix, x, y); };
  out.energy = energy_balance(product, mesh, out.solved.radiosity, out.factors.report.row_sum);
  return out;
}

}  // namespace interflect::cli
