#include "solve.h"

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
#include "interflect/output/lightmap.h"
#include "kept.h"
#include "launch.h"
#include "lightmap_options.h"
#include "outputs.h"
#include "page.h"
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
  bool page = false;  ///< see SolvingCommand
  std::vector<std::string> outputs;
  LightmapOptions lightmap;
  std::string report;
  SolvingOptions solving;
  std::string light_groups = "none";
  PictureText picture;
};

constexpr std::array extensions{".png", ".exr", ".ply", ".glb", ".csv", ".npy", ".html", ".json"};

/// The files that the solution goes to.
std::vector<std::string> result_files(const Options& options) {
  std::vector<std::string> files = options.outputs;
  files.insert(files.end(), options.lightmap.images.begin(), options.lightmap.images.end());
  return files;
}

bool is_picture(const std::string& path) {
  return extension_of(path) == ".png" || extension_of(path) == ".exr";
}

/// Everything about the outputs that can be wrong before the work starts.
void check_outputs(const Options& options) {
  std::vector<std::string> files = result_files(options);
  if (!options.report.empty()) files.push_back(options.report);
  for (const std::string& file : options.outputs) {
    if (std::find(extensions.begin(), extensions.end(), extension_of(file)) == extensions.end()) {
      throw Error(ErrorKind::usage,
                  fmt::format("-o {}: '{}' is not an output format (.png, .exr, .ply, .glb, .csv, .npy, .html, .json)",
                              file, extension_of(file)));
    }
  }
  check_lightmap(options.lightmap, options.outputs);
  // A file of form factors is read where it is there.
  std::error_code missing;
  const std::string& kept = options.solving.form_factors;
  if (!kept.empty() && !std::filesystem::exists(kept, missing)) files.push_back(kept);
  check_files(files, options.scene.file);
  for (const std::string& file : result_files(options)) {
    if (kept.empty() || !same_file(file, kept)) continue;
    throw Error(ErrorKind::usage, fmt::format("{} is the file of form factors: an output would destroy it", file));
  }
}

void check_scene_stays(const Options& options, const Scene& scene) {
  std::vector<std::string> outputs = result_files(options);
  if (!options.report.empty()) outputs.push_back(options.report);
  if (!options.solving.form_factors.empty()) outputs.push_back(options.solving.form_factors);
  check_inputs_stay(outputs, scene.files);
}

void write_outputs(const Options& options, const SolveSummary& summary, const PlacedSolve& placed,
                   std::optional<Atlas> atlas, ProgressSink& progress) {
  const MeshedScene& loaded = *summary.loaded;
  const Solution solution = solution_of(loaded, placed);
  const PictureOptions picture = picture_options(options.picture, loaded.scene.camera);
  std::optional<Lightmap> lightmap;
  if (atlas) lightmap = bake_lightmap(solution, std::move(*atlas));
  for (const std::string& file : options.lightmap.images) write_lightmap(*lightmap, file);
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
    if (extension == ".glb") write_glb(solution, file, lightmap ? &*lightmap : nullptr);
    if (extension == ".csv") write_csv(solution, file);
    if (extension == ".npy") write_npy(solution, file);
    if (extension == ".html") write_html(solution, page_options(summary), file);
    progress.advance(1);
  }
  progress.end();
}

void write_report(const SolveSummary& summary, const std::string& path) {
  AtomicFile file(path);
  file.write(dump(to_json(summary)));
  file.commit();
}

bool has_page(const Options& options) {
  const auto is_page = [](const std::string& file) { return extension_of(file) == ".html"; };
  return std::any_of(options.outputs.begin(), options.outputs.end(), is_page);
}

/// The page of `view`: where none is asked for, in this folder under the scene's name.
void ask_for_page(Options& options) {
  if (has_page(options)) return;
  if (!options.outputs.empty()) {
    throw Error(ErrorKind::usage,
                fmt::format("-o {}: view writes a page, which ends in .html", options.outputs.front()));
  }
  options.outputs.push_back(std::filesystem::path(options.scene.file).stem().string() + ".html");
}

/// For people: where the pages are, as a browser takes it.
void tell_pages(const Options& options) {
  for (const std::string& file : options.outputs) {
    if (extension_of(file) != ".html") continue;
    fmt::print("open           {}\n", std::filesystem::absolute(file).lexically_normal().string());
  }
}

int status_of(const SolveReport& report, const StopTest& stop) {
  if (report.interrupted) return exit_status(ErrorKind::interrupted);
  return report.converged || stop.iterations ? 0 : exit_status(ErrorKind::not_converged);
}

int run(Options options) {
  const Timer total;
  if (options.page) ask_for_page(options);
  Console console(voice_of(options.scene));
  Candidates candidates = together([&] {
    if (speaks()) check_outputs(options);
    check_picture(options.picture, std::any_of(options.outputs.begin(), options.outputs.end(), is_picture));
    Candidates asked = candidates_of(options.solving, console);
    asked.open();  // a device that is not there is found before the work, too
    return asked;
  });

  const SceneOptions as_kept =
      together([&] { return with_the_files_divide(options.scene, options.solving.form_factors); });
  const MeshedScene loaded = together([&] {
    MeshedScene scene = load(as_kept, console);
    check_scene_stays(options, scene.scene);
    return scene;
  });
  Lamps lamps{light_groups(loaded.scene, loaded.mesh, options.light_groups)};
  if (has_page(options)) lamps.bounces = bounces_for_page(loaded.mesh.size(), lamps.groups.names.size());
  const std::optional<Atlas> atlas = !speaks() ? std::nullopt : lightmap_atlas(options.lightmap, loaded.mesh, console);
  const PlacedSolve placed = solve_loaded(loaded, as_kept, options.solving, candidates, console, lamps);
  const Solved& solved = placed.solved;
  const AssemblyReport& assembled = placed.factors.report;
  if (!speaks()) return status_of(solved.report, options.solving.stop);

  SolveSummary summary{&loaded,       &assembled,     &solved, options.solving.chosen_method(), options.solving.stop,
                       placed.energy, placed.assembly};
  summary.kept = placed.kept;
  summary.ranks = placed.ranks;
  const Timer estimating;
  summary.row_error = row_sum_error(assembled.tile_variance, loaded.mesh.area);
  summary.radiosity_error =
      radiosity_error(assembled.tile_variance, loaded.mesh.area, loaded.mesh.reflectance, solved.radiosity);
  summary.estimate_seconds = estimating.seconds();
  const Timer writing;
  write_outputs(options, summary, placed, atlas, console);
  summary.write_seconds = writing.seconds();
  summary.total_seconds = total.seconds();
  for (const std::string& file : options.outputs) {
    if (extension_of(file) == ".json") write_report(summary, file);
  }
  if (!options.report.empty()) write_report(summary, options.report);

  if (!options.scene.quiet) {
    fmt::print("{}", to_text(summary));
    if (atlas) fmt::print("{}", lightmap_line(*atlas));
    for (const std::string& file : result_files(options)) fmt::print("wrote          {}\n", file);
    if (!options.report.empty()) fmt::print("wrote          {}\n", options.report);
    tell_pages(options);
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
  add_solving(program, action, {"solve", "solve a scene and write its light"});
}

void add_solving(CLI::App& program, Action& action, const SolvingCommand& which) {
  auto options = std::make_shared<Options>();
  options->page = which.page;
  CLI::App& command = *program.add_subcommand(which.name, which.description);
  add_scene_options(command, options->scene);
  command
      .add_option("-o,--output", options->outputs,
                  which.page
                      ? "the page, .html (default: the scene's name in this folder), and what else solve writes"
                      : "output, by extension: .png .exr .ply .glb .csv .npy .html .json (may be given several times)")
      ->type_size(1)
      ->allow_extra_args(false);
  add_lightmap_options(command, options->lightmap);
  command.add_option("--report", options->report, "the report as JSON")->check(file_name());
  add_solving_options(command, options->solving);
  if (which.page) options->light_groups = "auto";
  add_light_groups_option(command, options->light_groups);
  add_picture_options(command, options->picture);
  command.callback([options, &action, &command] {
    // A page is for dimming lamps; without one they are told apart only where that is asked for.
    if (command.count("--light-groups") == 0 && has_page(*options)) options->light_groups = "auto";
    action = [options] { return run(*options); };
  });
}

}  // namespace interflect::cli
