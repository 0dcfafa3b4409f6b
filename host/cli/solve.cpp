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
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/device/registry.h"
#include "interflect/output/lightmap.h"
#include "interflect/schedule/storage_choice.h"
#include "kept.h"
#include "lightmap_options.h"
#include "outputs.h"
#include "page.h"
#include "parse.h"
#include "pipeline.h"
#include "place.h"
#include "report.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  SceneOptions scene;
  bool page = false;  ///< see SolvingCommand
  std::vector<std::string> outputs;
  LightmapOptions lightmap;
  std::string report;
  std::string form_factors;
  std::string device = "auto";
  std::string method = "cg";
  std::string storage = "auto";
  std::string assembly = "auto";
  std::string light_groups = "none";
  StopTest stop;
  std::string camera, up = "0,1,0", size = "1280x720", tone = "filmic";
  std::optional<double> exposure;
  std::uint32_t samples = 16;
};

Method method_of(const std::string& text) {
  return text == "cg" ? Method::cg : text == "bicgstab" ? Method::bicgstab : Method::jacobi;
}

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
  const std::string& kept = options.form_factors;
  if (!kept.empty() && !std::filesystem::exists(kept, missing)) files.push_back(kept);
  check_files(files, options.scene.file);
  for (const std::string& file : result_files(options)) {
    if (kept.empty() || !same_file(file, kept)) continue;
    throw Error(ErrorKind::usage, fmt::format("{} is the file of form factors: an output would destroy it", file));
  }
}

/// What the scene is made of (materials, textures, buffers) is known once it is read.
void check_inputs_stay(const Options& options, const Scene& scene) {
  std::vector<std::string> outputs = result_files(options);
  if (!options.report.empty()) outputs.push_back(options.report);
  if (!options.form_factors.empty()) outputs.push_back(options.form_factors);
  for (const std::string& output : outputs) {
    for (const std::filesystem::path& input : scene.files) {
      if (!same_file(output, input.string())) continue;
      throw Error(ErrorKind::usage, fmt::format("{} belongs to the scene: an output would destroy it", output));
    }
  }
}

PictureOptions picture_options(const Options& options, const Scene& scene) {
  PictureOptions picture;
  const auto [width, height] = parse_size(options.size);
  picture.width = width;
  picture.height = height;
  picture.exposure = options.exposure;
  picture.tone = options.tone == "linear" ? ToneMap::linear : ToneMap::filmic;
  picture.samples = options.samples;
  picture.camera = options.camera.empty() ? scene.camera : parse_camera(options.camera, options.up);
  return picture;
}

/// A malformed --size or --camera, and a picture that will not fit, are found before the work.
void check_picture(const Options& options) {
  const PictureOptions picture = picture_options(options, Scene{});
  if (std::none_of(options.outputs.begin(), options.outputs.end(), is_picture)) return;
  // Linear and displayed values in single precision, then the bytes of one file, plain and packed.
  constexpr std::uint64_t bytes_per_pixel = 6 * sizeof(float) + 6 * sizeof(std::uint16_t);
  const std::uint64_t needed = bytes_per_pixel * picture.width * picture.height;
  const std::uint64_t available = available_memory();
  if (needed <= available) return;
  constexpr double mebibyte = 1 << 20;
  throw Error(
      ErrorKind::limit,
      fmt::format("--size {}: the picture needs {:.0f} MiB, and {:.0f} MiB may be used: use a smaller one",
                  options.size, static_cast<double>(needed) / mebibyte, static_cast<double>(available) / mebibyte));
}

void write_outputs(const Options& options, const SolveSummary& summary, const PlacedSolve& placed,
                   std::optional<Atlas> atlas, ProgressSink& progress) {
  const MeshedScene& loaded = *summary.loaded;
  const Solution solution = solution_of(loaded, placed);
  const PictureOptions picture = picture_options(options, loaded.scene);
  std::optional<Lightmap> lightmap;
  if (atlas) lightmap = bake_lightmap(solution, std::move(*atlas));
  for (const std::string& file : options.lightmap.images) write_lightmap(*lightmap, file);
  std::optional<Picture> rendered;  // one for .png and .exr together
  for (const std::string& file : options.outputs) {
    const std::string extension = extension_of(file);
    if (is_picture(file) && !rendered) rendered = render(solution, picture, &progress);
    if (extension == ".png") write_png(*rendered, picture.tone, file);
    if (extension == ".exr") write_exr(*rendered, file);
    if (extension == ".ply") write_ply(solution, file);
    if (extension == ".glb") write_glb(solution, file, lightmap ? &*lightmap : nullptr);
    if (extension == ".csv") write_csv(solution, file);
    if (extension == ".npy") write_npy(solution, file);
    if (extension == ".html") write_html(solution, page_options(summary), file);
  }
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

int run(Options options) {
  const Timer total;
  if (options.page) ask_for_page(options);
  Console console(options.scene.quiet);
  check_outputs(options);
  check_picture(options);
  Candidates candidates(
      choose_devices(options.device), [](const std::string& id) { return open_device(id); }, &console);
  candidates.open();  // a device that is not there is found before the work, too

  const SceneOptions as_kept = with_the_files_divide(options.scene, options.form_factors);
  const MeshedScene loaded = load(as_kept, console);
  check_inputs_stay(options, loaded.scene);
  Lamps lamps{light_groups(loaded.scene, loaded.mesh, options.light_groups)};
  if (has_page(options)) lamps.bounces = bounces_for_page(loaded.mesh.size(), lamps.groups.names.size());
  const std::optional<Atlas> atlas = lightmap_atlas(options.lightmap, loaded.mesh, console);
  const Method method = method_of(options.method);
  Assembler assembler(candidates, assembly_place(options.assembly));
  const PlacedSolve placed = options.form_factors.empty()
                                 ? assemble_and_solve(loaded, options.scene, assembler, storage_of(options.storage),
                                                      method, options.stop, console, lamps)
                                 : solve_kept(options.form_factors, loaded, as_kept, assembler,
                                              storage_of(options.storage), method, options.stop, console, lamps);
  const Solved& solved = placed.solved;
  const AssemblyReport& assembled = placed.factors.report;

  SolveSummary summary{&loaded, &assembled, &solved, method, options.stop, placed.energy, placed.assembly};
  summary.kept = placed.kept;
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
  if (solved.report.converged || options.stop.iterations) return 0;
  fmt::print(stderr, "interflect: not converged: {}\n", solved.report.reason);
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
  command
      .add_option("--form-factors", options->form_factors,
                  "keep the form factors in this file (.iff), and take them from it when it fits the scene")
      ->check(file_name());
  command
      .add_option("--device", options->device,
                  "device id, see 'interflect devices'; several, as cuda:0,openmp, are tried in this order when one "
                  "fails")
      ->capture_default_str();
  command.add_option("--method", options->method, "cg, bicgstab or jacobi")
      ->check(CLI::IsMember({"cg", "bicgstab", "jacobi"}))
      ->capture_default_str();
  command.add_option("--tol", options->stop.tolerance, "relative residual to reach in every channel")
      ->check(number(0.0, 1.0))
      ->capture_default_str();
  auto* most = command.add_option("--max-iterations", options->stop.max_iterations, "give up after so many")
                   ->check(count(10'000'000))
                   ->capture_default_str();
  command.add_option("--iterations", options->stop.iterations, "exactly so many iterations, whatever the residual")
      ->check(count(10'000'000))
      ->excludes(most);
  command
      .add_option("--storage", options->storage, "storage of the form factors: auto, dense32, dense16, tiled16, sym16")
      ->check(CLI::IsMember({"auto", "dense32", "dense16", "tiled16", "sym16"}))
      ->capture_default_str();
  add_assembly_option(command, options->assembly);
  if (which.page) options->light_groups = "auto";
  add_light_groups_option(command, options->light_groups);
  auto* camera =
      command.add_option("--camera", options->camera, "EX,EY,EZ,TX,TY,TZ[,FOV]: eye, target, vertical degrees");
  command.add_option("--up", options->up, "the camera's up: X,Y,Z")->needs(camera)->capture_default_str();
  command.add_option("--size", options->size, "picture size: WIDTHxHEIGHT")->capture_default_str();
  command.add_option("--exposure", options->exposure, "factor on the radiosity before the tone curve")
      ->check(number(0.0));
  command.add_option("--tone", options->tone, "tone curve: linear, filmic")
      ->check(CLI::IsMember({"linear", "filmic"}))
      ->capture_default_str();
  command.add_option("--samples", options->samples, "samples per pixel")
      ->check(number(0U, 4096U))
      ->capture_default_str();
  command.callback([options, &action, &command] {
    // A page is for dimming lamps; without one they are told apart only where that is asked for.
    if (command.count("--light-groups") == 0 && has_page(*options)) options->light_groups = "auto";
    action = [options] { return run(*options); };
  });
}

}  // namespace interflect::cli
