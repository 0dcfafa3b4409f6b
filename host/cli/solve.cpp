#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/timer.h"
#include "kept.h"
#include "outputs.h"
#include "picture_options.h"
#include "pipeline.h"
#include "place.h"
#include "report.h"
#include "solving_options.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  SceneOptions scene;
  std::vector<std::string> outputs;
  std::string report;
  SolvingOptions solving;
  std::string light_groups = "none";
  PictureText picture;
};

constexpr std::array extensions{".png", ".exr", ".ply", ".glb", ".csv", ".npy", ".json"};

bool is_picture(const std::string& path) {
  return extension_of(path) == ".png" || extension_of(path) == ".exr";
}

/// Everything about the outputs that can be wrong before the work starts.
void check_outputs(const Options& options) {
  std::vector<std::string> files = options.outputs;
  if (!options.report.empty()) files.push_back(options.report);
  for (const std::string& file : options.outputs) {
    if (std::find(extensions.begin(), extensions.end(), extension_of(file)) == extensions.end()) {
      throw Error(ErrorKind::usage,
                  fmt::format("-o {}: '{}' is not an output format (.png, .exr, .ply, .glb, .csv, .npy, .json)", file,
                              extension_of(file)));
    }
  }
  // A file of form factors is read where it is there.
  std::error_code missing;
  const std::string& kept = options.solving.form_factors;
  if (!kept.empty() && !std::filesystem::exists(kept, missing)) files.push_back(kept);
  check_files(files, options.scene.file);
  for (const std::string& file : options.outputs) {
    if (kept.empty() || !same_file(file, kept)) continue;
    throw Error(ErrorKind::usage, fmt::format("{} is the file of form factors: an output would destroy it", file));
  }
}

/// What the scene is made of (materials, textures, buffers) is known once it is read.
void check_inputs_stay(const Options& options, const Scene& scene) {
  std::vector<std::string> outputs = options.outputs;
  if (!options.report.empty()) outputs.push_back(options.report);
  if (!options.solving.form_factors.empty()) outputs.push_back(options.solving.form_factors);
  for (const std::string& output : outputs) {
    for (const std::filesystem::path& input : scene.files) {
      if (!same_file(output, input.string())) continue;
      throw Error(ErrorKind::usage, fmt::format("{} belongs to the scene: an output would destroy it", output));
    }
  }
}

void write_outputs(const Options& options, const MeshedScene& loaded, const PlacedSolve& placed,
                   ProgressSink& progress) {
  const Solution solution = solution_of(loaded, placed);
  const PictureOptions picture = picture_options(options.picture, loaded.scene.camera);
  std::optional<Picture> rendered;  // one for .png and .exr together
  if (std::any_of(options.outputs.begin(), options.outputs.end(), is_picture)) {
    rendered = render(solution, picture, &progress);
  }
  progress.begin("Write", options.outputs.size());
  for (const std::string& file : options.outputs) {
    const std::string extension = extension_of(file);
    if (extension == ".png") write_png(*rendered, picture.tone, file);
    if (extension == ".exr") write_exr(*rendered, file);
    if (extension == ".ply") write_ply(solution, file);
    if (extension == ".glb") write_glb(solution, file);
    if (extension == ".csv") write_csv(solution, file);
    if (extension == ".npy") write_npy(solution, file);
    progress.advance(1);
  }
  progress.end();
}

void write_report(const SolveSummary& summary, const std::string& path) {
  AtomicFile file(path);
  file.write(dump(to_json(summary)));
  file.commit();
}

int run(const Options& options) {
  const Timer total;
  Console console(voice_of(options.scene));
  check_outputs(options);
  check_picture(options.picture, std::any_of(options.outputs.begin(), options.outputs.end(), is_picture));
  Candidates candidates = candidates_of(options.solving, console);
  candidates.open();  // a device that is not there is found before the work, too

  const SceneOptions as_kept = with_the_files_divide(options.scene, options.solving.form_factors);
  const MeshedScene loaded = load(as_kept, console);
  check_inputs_stay(options, loaded.scene);
  const Lamps lamps{light_groups(loaded.scene, loaded.mesh, options.light_groups)};
  const PlacedSolve placed = solve_loaded(loaded, as_kept, options.solving, candidates, console, lamps);
  const Solved& solved = placed.solved;
  const AssemblyReport& assembled = placed.factors.report;

  SolveSummary summary{&loaded,       &assembled,     &solved, options.solving.chosen_method(), options.solving.stop,
                       placed.energy, placed.assembly};
  summary.kept = placed.kept;
  const Timer estimating;
  summary.row_error = row_sum_error(assembled.tile_variance, loaded.mesh.area);
  summary.radiosity_error =
      radiosity_error(assembled.tile_variance, loaded.mesh.area, loaded.mesh.reflectance, solved.radiosity);
  summary.estimate_seconds = estimating.seconds();
  const Timer writing;
  write_outputs(options, loaded, placed, console);
  summary.write_seconds = writing.seconds();
  summary.total_seconds = total.seconds();
  for (const std::string& file : options.outputs) {
    if (extension_of(file) == ".json") write_report(summary, file);
  }
  if (!options.report.empty()) write_report(summary, options.report);

  if (!options.scene.quiet) {
    fmt::print("{}", to_text(summary));
    for (const std::string& file : options.outputs) fmt::print("wrote          {}\n", file);
    if (!options.report.empty()) fmt::print("wrote          {}\n", options.report);
  }
  if (console.interrupted()) {
    say_error(ErrorKind::interrupted,
              solved.report.interrupted
                  ? fmt::format("what was asked for is written from the best so far: {}", solved.report.reason)
                  : "the solve was done, and what was asked for is written");
    return exit_status(ErrorKind::interrupted);
  }
  if (solved.report.converged || options.solving.stop.iterations) return 0;
  say_error(ErrorKind::not_converged, solved.report.reason);
  return exit_status(ErrorKind::not_converged);
}

}  // namespace

void add_solve(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("solve", "solve a scene and write its light");
  add_scene_options(command, options->scene);
  command
      .add_option("-o,--output", options->outputs,
                  "output, by extension: .png .exr .ply .glb .csv .npy .json (may be given several times)")
      ->type_size(1)
      ->allow_extra_args(false);
  command.add_option("--report", options->report, "the report as JSON")->check(file_name());
  add_solving_options(command, options->solving);
  add_light_groups_option(command, options->light_groups);
  add_picture_options(command, options->picture);
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
