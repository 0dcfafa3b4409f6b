#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "assembler.h"
#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/estimate.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/output/matrix_file.h"
#include "kept.h"
#include "launch.h"
#include "outputs.h"
#include "pipeline.h"
#include "rank_solve.h"
#include "report.h"

namespace interflect::cli {

namespace {

struct Options {
  SceneOptions scene;
  std::vector<std::string> outputs;
  std::string device = "auto";
  std::string assembly = "auto";
  bool repair = false;
  bool between = false;
  bool json = false;
};

/// F and what is known of it, in memory or in a file.
struct Known {
  std::optional<MeshedScene> loaded;  ///< none: from a file alone
  std::optional<FormFactors> computed;
  std::optional<IffFile> file;  ///< none: computed
  Kept kept;
  AssemblyUse assembly;
  AssemblyReport report;
  Grouping grouping;
  double divide = 0;

  [[nodiscard]] FormFactorRows rows() const { return computed ? rows_of(computed->matrix) : rows_of(*file); }
  [[nodiscard]] const std::vector<double>& area() const { return loaded ? loaded->mesh.area : file->area(); }
  [[nodiscard]] const std::vector<std::uint32_t>& surface() const {
    return loaded ? loaded->mesh.surface : file->closing().surface;
  }
  [[nodiscard]] std::string object_of(std::uint32_t patch) const {
    if (loaded) {
      const Surface& s = loaded->mesh.surfaces[surface()[patch]];
      return s.object.empty() ? s.group : s.object;
    }
    const SurfaceNames& s = file->closing().surfaces[surface()[patch]];
    return s.object.empty() ? s.group : s.object;
  }
};

std::string shown(const std::string& name) {
  return name.empty() ? "(unnamed)" : name;
}

void print_table(const GroupFactors& table) {
  std::size_t widest = 9;
  for (const std::string& group : table.groups) widest = std::max(widest, shown(group).size());
  widest = std::min<std::size_t>(widest, 24);
  const auto cell = [&](const std::string& text) { return fmt::format("{:>{}.{}}", text, widest, widest); };
  fmt::print("{}  {}", cell("from \\ to"), cell("area"));
  for (const std::string& group : table.groups) fmt::print("  {}", cell(shown(group)));
  fmt::print("  {}  {}\n", cell("sum"), cell("sky"));
  for (std::size_t a = 0; a < table.groups.size(); ++a) {
    fmt::print("{}  {:>{}.6g}", cell(shown(table.groups[a])), table.areas[a], widest);
    double sum = 0;
    for (const double f : table.factors[a]) {
      fmt::print("  {:>{}.6f}", f, widest);
      sum += f;
    }
    fmt::print("  {:>{}.6f}  {:>{}.6f}\n", sum, widest, table.sky[a], widest);
  }
  if (!table.left_out.empty()) fmt::print("left out: {} (in the way only)\n", fmt::join(table.left_out, ", "));
}

constexpr std::array extensions{".iff", ".npy", ".mtx"};

bool is_iff(const std::string& path) {
  return extension_of(path) == ".iff";
}

/// The one .iff among the outputs, or nothing.
std::string file_of(const Options& options) {
  const auto found = std::find_if(options.outputs.begin(), options.outputs.end(), is_iff);
  return found == options.outputs.end() ? "" : *found;
}

/// Everything about the options that can be wrong before the work starts.
void check(const Options& options) {
  for (const std::string& file : options.outputs) {
    if (std::find(extensions.begin(), extensions.end(), extension_of(file)) == extensions.end()) {
      throw Error(ErrorKind::usage,
                  fmt::format("-o {}: '{}' is not an output format (.iff, .npy, .mtx)", file, extension_of(file)));
    }
  }
  if (std::count_if(options.outputs.begin(), options.outputs.end(), is_iff) > 1) {
    throw Error(ErrorKind::usage, "-o: one .iff file is enough");
  }
  const bool from_file = is_iff(options.scene.file);
  if (from_file && !file_of(options).empty()) {
    throw Error(ErrorKind::usage,
                fmt::format("-o {}: {} is such a file already", file_of(options), options.scene.file));
  }
  if (options.repair && (from_file || file_of(options).empty())) {
    throw Error(ErrorKind::usage, "--repair computes from the scene: formfactors SCENE -o FILE.iff --repair");
  }
  const SceneOptions& scene = options.scene;
  if (from_file &&
      (scene.divide || scene.patches || scene.two_sided || scene.accuracy || scene.seed || scene.closure != "auto")) {
    throw Error(ErrorKind::usage,
                fmt::format("{} has its form factors: only --between, --group-by, --json and -o apply", scene.file));
  }
  static_cast<void>(accuracy_asked(scene));  // a wrong one is found before the scene is read
  std::vector<std::string> files = options.outputs;
  if (options.repair) std::erase_if(files, is_iff);
  check_files(files, scene.file);
}

Known from_file(const std::string& file, const SceneOptions& options) {
  Known known;
  known.file = IffFile::open(file);
  known.report = known.file->report();
  known.kept = kept_of(file, known.file->shape(), known.file->panels(), "reused");
  known.grouping = group_surfaces(*known.file, group_by(options.group_by));
  known.divide = known.file->divide();
  return known;
}

void take(Known& known, KeptFormFactors computed) {
  known.report = computed.factors.report;
  if (computed.panels != nullptr) {
    known.file = IffFile::open(computed.kept.file);
  } else {
    known.computed = std::move(computed.factors);
  }
  known.kept = std::move(computed.kept);
}

/// Of several ranks. What is not there yet all ranks make; the rest is rank 0's.
void keep_by_ranks(Known& known, const Options& options, const MeshedScene& loaded, Assembler& assembler,
                   Console& progress) {
  const std::string file = file_of(options);
  const auto refuse = [](const char* what) {
    throw AgreedError(ErrorKind::usage, fmt::format("{} on several ranks: start it without mpirun", what));
  };
  if (file.empty()) refuse("formfactors without -o FILE.iff does not run");
  if (options.repair) refuse("--repair does not run");
  const bool there = ranks().rank_zeros(together([&] { return fits(file, loaded, options.scene, progress); }));
  if (there && !ranks().rank_zeros(together([&] { return is_closed(file, options.scene); }))) {
    refuse("another --closure of a file that is there is not found");
  }
  if (!there) {
    KeptFormFactors computed = keep_on_ranks(file, loaded, options.scene, assembler, progress);
    known.report = std::move(computed.factors.report);
    known.kept = std::move(computed.kept);
  }
  if (!speaks()) return;
  if (there) {
    progress.message(fmt::format("{}: is there and fits: its form factors are used", file));
    known = from_file(file, options.scene);
  } else {
    known.file = IffFile::open(file);
  }
}

Known from_scene(const Options& options, Console& progress) {
  const auto shared = options.device == "auto" ? std::nullopt : std::optional(SplitOptions{});
  Candidates candidates(
      devices_of_rank(options.device), [](const std::string& id) { return open_device(id); }, &progress, shared);
  Assembler assembler(candidates, assembly_place(options.assembly));
  const std::string file = file_of(options);
  std::error_code missing;
  const bool repairs = options.repair && std::filesystem::exists(file, missing);
  if (options.repair && !repairs && !std::filesystem::exists(file + ".partial", missing)) {
    throw input_error(file, 0, "is not there: there is nothing to repair");
  }
  MeshedScene loaded = together([&] { return load(options.scene, progress); });
  for (const std::string& output : options.outputs) {
    for (const std::filesystem::path& input : loaded.scene.files) {
      if (!same_file(output, input.string())) continue;
      throw Error(ErrorKind::usage, fmt::format("{} belongs to the scene: an output would destroy it", output));
    }
  }
  Known known;
  if (ranks().size() > 1) {
    keep_by_ranks(known, options, loaded, assembler, progress);
  } else if (repairs) {
    take(known, repair(file, loaded, options.scene, assembler, progress));
  } else if (file.empty()) {
    take(known, {assemble_in_memory(loaded, options.scene, "-o FILE.iff", assembler, progress), {}});
  } else if (!fits(file, loaded, options.scene, progress)) {
    take(known, keep(file, loaded, options.scene, assembler, progress));
  } else if (!is_closed(file, options.scene)) {
    take(known, close_again(file, loaded, options.scene, assembler, progress));
  } else {
    progress.message(fmt::format("{}: is there and fits: its form factors are used", file));
    known = from_file(file, options.scene);
  }
  known.assembly = assembler.use();
  known.grouping = loaded.grouping;
  known.divide = loaded.divide;
  known.loaded = std::move(loaded);
  return known;
}

void write_outputs(const Options& options, const Known& known) {
  const auto n = static_cast<std::uint32_t>(known.area().size());
  for (const std::string& file : options.outputs) {
    if (extension_of(file) == ".npy") write_matrix_npy(known.rows(), n, file);
    if (extension_of(file) != ".mtx") continue;
    const std::string comment =
        fmt::format("form factors F(i, j), the share of what leaves patch i that arrives at patch j, by interflect {}",
                    INTERFLECT_VERSION);
    write_matrix_market(known.rows(), n, comment, file);
  }
}

double nonzero_fraction(const Known& known) {
  const auto n = static_cast<double>(known.area().size());
  std::uint64_t count = 0;
  known.rows()([&](std::uint32_t, std::span<const float> row) {
    for (const float f : row) count += f != 0.0F ? 1 : 0;
  });
  return static_cast<double>(count) / (n * n);
}

void print_between(const Options& options, const Known& known) {
  GroupFactors table = between(known.rows(), known.area(), known.surface(), known.grouping);
  // What a buried patch in a closed scene does not see is the inside of other objects, not the sky.
  if (known.report.closed_scene) std::fill(table.sky.begin(), table.sky.end(), 0.0);
  if (!options.json) return print_table(table);
  nlohmann::ordered_json out;
  out["groups"] = table.groups;
  out["areas"] = table.areas;
  out["factors"] = table.factors;
  out["sky"] = table.sky;
  if (!table.left_out.empty()) out["left_out"] = table.left_out;
  fmt::print("{}", dump(out));
}

void print_report(const Options& options, const Known& known) {
  const AssemblyReport& report = known.report;
  const double nonzero = nonzero_fraction(known);  // also reads all panels of a file, and so checks them
  const EstimatedError error = row_sum_error(report.tile_variance, known.area());
  if (options.json) {
    nlohmann::ordered_json out;
    out["scene"] = options.scene.file;
    out["patches"] = known.area().size();
    out["divide"] = known.divide;
    out["seconds"] = report.seconds;
    out["assembly"] = assembly_json(report, known.assembly);
    out["nonzero_fraction"] = nonzero;
    out["closure"] = closure_json(report, [&](std::uint32_t i) { return known.object_of(i); });
    out["form_factors"] = kept_json(known.kept);
    out["estimated_error"] = {{"row_sum", error_json(error)}};
    fmt::print("{}", dump(out));
    return;
  }
  fmt::print("scene          {}: {} patches (--divide {:.6g})\n", options.scene.file, known.area().size(),
             known.divide);
  fmt::print("form factors   {:.2f} s on {}, {} facing pairs, {} by the contour form, {} rays\n", report.seconds,
             known.assembly.device, report.pairs_considered, report.pairs_analytic, report.rays);
  fmt::print("{}", kept_text(known.kept));
  fmt::print("{}", closure_text(report));
  fmt::print("sampling       row sums {:.1e} rms, {:.1e} at most\n", error.rms, error.max);
  for (const std::string& file : options.outputs) {
    if (!is_iff(file)) fmt::print("wrote          {}\n", file);
  }
}

int run(const Options& options) {
  Console console(voice_of(options.scene));
  agreed(ranks(), [&] {
    if (speaks()) check(options);
  });
  const bool alone = is_iff(options.scene.file);
  if (alone && !speaks()) return 0;
  const Known known = alone ? from_file(options.scene.file, options.scene) : from_scene(options, console);
  if (!speaks()) return 0;
  if (known.file && known.kept.done == "reused") report_warnings(known.report, known.file->name(), console);
  write_outputs(options, known);
  if (options.between) {
    print_between(options, known);
  } else {
    print_report(options, known);
  }
  return 0;
}

}  // namespace

void add_formfactors(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("formfactors", "compute form factors, keep them, say how good they are");
  add_scene_options(command, options->scene,
                    "scene: .xml (rrv), .obj, .gltf, .glb or .vs3 (View3D); or a file of form factors (.iff)");
  command.add_option("--device", options->device, "device id, several, or auto, as for solve; see --assembly")
      ->capture_default_str();
  add_assembly_option(command, options->assembly);
  command
      .add_option("-o,--output", options->outputs,
                  "output, by extension: .iff (kept: an interrupted run goes on, a finished one is reused), .npy, .mtx "
                  "(may be given several times)")
      ->type_size(1)
      ->allow_extra_args(false);
  command.add_flag("--repair", options->repair, "compute again what is damaged in -o FILE.iff");
  command.add_flag("--between", options->between, "print the factors between groups (see --group-by)");
  command.add_flag("--json", options->json, "print JSON");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
