#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "interflect/output/html.h"
#include "interflect/schedule/storage_choice.h"
#include "interflect/serve/server.h"
#include "interflect/serve/site.h"
#include "kept.h"
#include "pipeline.h"
#include "serve_measure.h"
#include "tune.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  SceneOptions scene;
  std::string host = "127.0.0.1";
  std::uint16_t port = 8080;
  std::string form_factors, device = "auto", method = "cg", storage = "auto", assembly = "auto", light_groups = "auto";
  double tolerance = 1e-4;
  std::uint32_t max_iterations = 200;
  std::optional<double> measure;
};

/// F in memory, or in a file from which panels are read.
struct FormFactorSource {
  FormFactors factors;
  AssemblyUse assembly;
  std::shared_ptr<const IffPanels> panels;
  std::optional<StreamedMatrix> streamed;
  std::map<std::pair<Storage, std::uint32_t>, std::shared_ptr<const PackedMatrix>> packed;
};

void fill(FormFactorSource& source, const Options& options, const SceneOptions& scene_options,
          const MeshedScene& loaded, Assembler& assembler, Console& console) {
  if (options.form_factors.empty()) {
    source.factors = assemble_in_memory(loaded, scene_options, "--form-factors FILE.iff", assembler, console);
  } else {
    KeptFormFactors kept = form_factors_for_solve(options.form_factors, loaded, scene_options, assembler, console);
    source.factors = std::move(kept.factors);
    source.panels = std::move(kept.panels);
    if (source.panels != nullptr) {
      source.streamed.emplace(*source.panels, loaded.mesh.area, source.factors.report.scaling, kept.memory);
    }
  }
  source.assembly = assembler.use();
}

/// As solve_scene() and solve_streamed() place F.
serve::Placement placement_of(FormFactorSource& source, const PatchMesh& mesh, const std::string& storage,
                              ProgressSink& progress) {
  const auto place = [&source, &mesh, &progress, asked = storage_of(storage)](std::unique_ptr<Device> device,
                                                                              std::uint32_t columns, bool dense32) {
    const auto n = static_cast<std::uint32_t>(mesh.size());
    Storage format = asked.value_or(source.streamed ? Storage::dense32 : choose_storage(n, device->info()));
    if (dense32) format = Storage::dense32;
    if (source.streamed && format != Storage::dense32) {
      throw Error(ErrorKind::limit, fmt::format("--storage {} is packed from all form factors at once, and they do not "
                                                "fit the memory: use --storage dense32, or a larger --memory",
                                                name(format)));
    }
    tune_on_first_use(*device, format, n, progress);
    const DeviceInfo info = device->info();
    const std::uint32_t block = sym16_block(info, n);
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(std::move(device));
    serve::PlacedFormFactors placed;
    if (source.streamed) {
      placed.scheduler = std::make_unique<Scheduler>(*source.streamed, std::move(devices), columns);
    } else if (format == Storage::dense32) {
      placed.scheduler = std::make_unique<Scheduler>(source.factors.matrix, std::move(devices), columns);
    } else {
      auto& packed = source.packed[{format, block}];
      if (!packed) packed = std::make_shared<const PackedMatrix>(pack(source.factors.matrix, mesh, format, block));
      placed.scheduler =
          std::make_unique<Scheduler>(*packed, std::move(devices), columns_of_packed(*packed, info, columns));
      placed.matrix = packed;
    }
    return placed;
  };
  return {[](const std::string& id) { return open_device(id); }, place,
          source.streamed ? nullptr : &source.factors.matrix};
}

std::vector<std::string> material_names(const Scene& scene) {
  std::vector<std::string> names;
  for (const Material& material : scene.materials) names.push_back(material.name);
  return names;
}

std::string page_of(const MeshedScene& loaded, const FormFactorSource& source, const serve::LiveScene& live,
                    const serve::LiveSolver& solver, const Options& options) {
  const LitPatches lit = lit_patches(solver.last().radiosity, live.groups());
  Solution solution{&loaded.mesh, loaded.grouping, lit.all, source.factors.report.row_sum};
  solution.lights = live.groups();
  solution.lit = lit.by_group;
  PageOptions page;
  page.title = loaded.scene.name;
  page.materials = material_names(loaded.scene);
  page.camera = loaded.scene.camera;
  page.served = true;
  const AssemblyReport& report = source.factors.report;
  page.statistics = {
      {"Triangles", fmt::format("{}", loaded.scene.triangles.size())},
      {"Patches", fmt::format("{}", loaded.mesh.size())},
      {"Method", options.method},
      {"Form factors", fmt::format("{:.3g} s on {}", report.seconds, source.assembly.device)},
      {"Row sums", fmt::format("{:.4f} to {:.4f}", report.after.min, report.after.max)},
      {"Interflect", INTERFLECT_VERSION},
  };
  std::string text;
  make_page(solution, page, [&](std::string_view piece) { text += piece; });
  return text;
}

int serve_until_told(const Options& options, serve::Server& server, serve::Desk& desk) {
  std::exception_ptr failed;
  std::thread connections([&] {
    try {
      server.run();
    } catch (...) {
      failed = std::current_exception();
      desk.stop();
    }
  });
  if (!options.scene.quiet && !serve::Guard(options.host).loopback()) {
    fmt::print(stderr, "interflect: warning: whoever reaches {}:{} can drive the solver\n", options.host,
               server.port());
  }
  const bool v6 = options.host.find(':') != std::string::npos;
  fmt::print("serving        http://{}{}{}:{}/   (Ctrl-C ends)\n", v6 ? "[" : "", options.host, v6 ? "]" : "",
             server.port());
  std::fflush(stdout);
  desk.run();
  server.stop();
  connections.join();
  if (failed) std::rethrow_exception(failed);
  if (!options.scene.quiet) fmt::print("ended\n");
  return 0;
}

/// The page's light groups, then all lamps together.
int measure(const Options& options, const MeshedScene& loaded, const serve::LiveScene& live, serve::LiveSolver& solver,
            const serve::Placement& placement, Method method, Console& console) {
  const auto line = [&](const serve::LiveScene& scene, serve::LiveSolver& on) {
    const LiveMeasurement measured = measure_live(on, scene, options.tolerance, *options.measure);
    fmt::print("{}", live_table_line(loaded.scene.name, scene, on.last(), measured));
    return measured;
  };
  fmt::print("{}", live_table_head());
  const LiveMeasurement measured = line(live, solver);
  if (live.lamps() > 1) {
    const serve::LiveScene together(loaded.mesh, {}, material_names(loaded.scene));
    serve::LiveSolver all(together, {solver.device()}, placement, method, options.max_iterations, options.tolerance,
                          console);
    line(together, all);
  }
  fmt::print("edits: the reflectance of '{}' by 0.1 and back; p: products per solve; medians\n", measured.wall);
  return 0;
}

int run(const Options& options) {
  Console console(voice_of(options.scene));
  const auto open = [](const std::string& id) { return open_device(id); };
  Candidates candidates(choose_devices(options.device), open, &console);
  candidates.open();
  const SceneOptions as_kept = with_the_files_divide(options.scene, options.form_factors);
  const MeshedScene loaded = load(as_kept, console);
  const serve::LiveScene live(loaded.mesh, light_groups(loaded.scene, loaded.mesh, options.light_groups),
                              material_names(loaded.scene));
  Assembler assembler(candidates, assembly_place(options.assembly));
  // A port that is taken is found before the work.
  serve::Desk desk(32);
  std::unique_ptr<serve::Site> site;
  const serve::Handler handler{
      [&](const serve::Request& request) { return site->refuse(request); },
      [&](const serve::Request& request, serve::Desk::Done done) { site->answer(request, std::move(done)); }};
  std::unique_ptr<serve::Server> server;
  if (!options.measure) server = std::make_unique<serve::Server>(options.host, options.port, handler);

  FormFactorSource source;
  fill(source, options, as_kept, loaded, assembler, console);
  std::vector<std::string> devices = choose_devices(options.device);
  devices.erase(devices.begin(), std::find(devices.begin(), devices.end(), candidates.id()));
  const Method method = options.method == "cg"         ? Method::cg
                        : options.method == "bicgstab" ? Method::bicgstab
                                                       : Method::jacobi;
  const serve::Placement placement = placement_of(source, loaded.mesh, options.storage, console);
  serve::LiveSolver solver(live, std::move(devices), placement, method, options.max_iterations, options.tolerance,
                           console);
  if (options.measure) return measure(options, loaded, live, solver, placement, method, console);
  site = std::make_unique<serve::Site>(serve::Guard(options.host), page_of(loaded, source, live, solver, options), live,
                                       solver, desk, options.tolerance, [] { return list_devices(); });
  server->on_signal([&] { desk.stop(); });
  return serve_until_told(options, *server, desk);
}

void add_solver_options(CLI::App& command, Options& options) {
  command
      .add_option("--form-factors", options.form_factors,
                  "take the form factors from this file (.iff), or keep them in it")
      ->check(file_name());
  command.add_option("--device", options.device, "device id to begin with, see 'interflect devices'")
      ->capture_default_str();
  command.add_option("--method", options.method, "cg, bicgstab or jacobi")
      ->check(CLI::IsMember({"cg", "bicgstab", "jacobi"}))
      ->capture_default_str();
  command.add_option("--tol", options.tolerance, "relative residual to reach, until the page asks for another")
      ->check(number(0.0, 0.1))
      ->capture_default_str();
  command.add_option("--max-iterations", options.max_iterations, "give up a solve after so many")
      ->check(count(10'000'000))
      ->capture_default_str();
  command
      .add_option("--storage", options.storage,
                  "storage of the form factors: auto, dense32, dense16, tiled16, sym16 (large rooms: several times as "
                  "many solves a "
                  "second, radiosities within 1e-3)")
      ->check(CLI::IsMember({"auto", "dense32", "dense16", "tiled16", "sym16"}))
      ->capture_default_str();
  add_assembly_option(command, options.assembly);
  add_light_groups_option(command, options.light_groups);
}

}  // namespace

void add_serve(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command =
      *program.add_subcommand("serve", "the page of 'view' with the solver behind it: change walls and lamps, live");
  add_scene_options(command, options->scene);
  command
      .add_option("--host", options->host, "address to listen on; other machines can come in only where it is theirs")
      ->capture_default_str();
  command.add_option("--port", options->port, "port to listen on; 0: any that is free")
      ->check(count(65535))
      ->capture_default_str();
  add_solver_options(command, *options);
  command
      .add_option("--measure", options->measure,
                  "no server: change a wall's reflectance back and forth for so many seconds, and print what it takes")
      ->check(number(0.0, 3600.0));
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
