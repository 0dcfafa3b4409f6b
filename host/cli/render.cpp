#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "camera_path.h"
#include "commands.h"
#include "console.h"
#include "frame_names.h"
#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/output/lens.h"
#include "interflect/output/lit_mesh.h"
#include "interflect/output/renderer.h"
#include "kept.h"
#include "outputs.h"
#include "picture_options.h"
#include "pipeline.h"
#include "solving_options.h"
#include "validators.h"

// Pictures of a solved scene, one or a film.

namespace interflect::cli {

namespace {

struct Options {
  SceneOptions scene;
  SolvingOptions solving;
  PictureText picture;
  std::vector<std::string> outputs;
  std::string path;
  bool orbit = false;
  std::optional<std::uint32_t> frames;
  std::uint32_t first = 0;
  double fps = 30;

  [[nodiscard]] bool film() const { return orbit || !path.empty(); }
};

/// What is looked at: a GLB that was solved before, or a scene that has just been solved. It stays where it is: the
/// renderer refers to it.
struct Lit {
  std::optional<LitMesh> file;
  MeshedScene loaded;
  Solution solution;
  std::unique_ptr<Renderer> renderer;
  std::optional<Camera> camera;               ///< the scene's
  std::vector<std::filesystem::path> inputs;  ///< files that must stay
  std::optional<SolveReport> solved;          ///< where it was solved here
};

std::unique_ptr<Lit> look_into(const Options& options, Console& console) {
  auto held = std::make_unique<Lit>();
  Lit& lit = *held;
  if (extension_of(options.scene.file) == ".glb") {
    console.begin("Read", 0);
    lit.file = read_solved_glb(options.scene.file);
    console.end();
  }
  if (lit.file) {
    lit.inputs = {options.scene.file};
    lit.renderer = std::make_unique<Renderer>(*lit.file);
    return held;
  }
  Candidates candidates = candidates_of(options.solving, console);
  candidates.open();
  const SceneOptions scene = with_the_files_divide(options.scene, options.solving.form_factors);
  lit.loaded = load(scene, console);
  lit.camera = lit.loaded.scene.camera;
  lit.inputs = lit.loaded.scene.files;
  if (!options.film()) check_inputs_stay(options.outputs, lit.inputs);  // a film's names are known with its cameras
  const PlacedSolve placed = solve_loaded(lit.loaded, scene, options.solving, candidates, console);
  lit.solved = placed.solved.report;
  lit.solution = solution_of(lit.loaded, placed);
  lit.renderer = std::make_unique<Renderer>(lit.solution);
  return held;
}

/// The camera of every frame.
std::vector<Camera> cameras_of(const Options& options, const Camera& usual, double aspect) {
  std::vector<Camera> cameras;
  if (!options.path.empty()) {
    const CameraPath path = read_camera_path(options.path, usual);
    const double length = path.end() - path.begin();
    constexpr double most = 1e6;
    const double wanted = options.frames ? *options.frames : std::round(length * options.fps) + 1;
    if (!(wanted <= most)) {
      throw Error(ErrorKind::usage,
                  fmt::format("--path {}: {:.0f} frames, {:.0f} is the most", options.path, wanted, most));
    }
    const auto frames = static_cast<std::size_t>(wanted);
    for (std::size_t k = 0; k < frames; ++k) {
      const double share = frames > 1 ? static_cast<double>(k) / static_cast<double>(frames - 1) : 0;
      cameras.push_back(path.at(path.begin() + share * length));
    }
  } else if (options.orbit) {
    constexpr std::uint32_t usual_frames = 120;
    const std::uint32_t frames = options.frames.value_or(usual_frames);
    for (std::uint32_t k = 0; k < frames; ++k) cameras.push_back(orbit(usual, k, frames));
  } else {
    cameras.push_back(usual);
  }
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    try {
      (void)Lens(cameras[k], aspect);
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("frame {}: {}", k, error.what()));
    }
  }
  return cameras;
}

/// One exposure for a film, from cameras all along it, so that it does not flicker and does not depend on --first.
double film_exposure(const Renderer& renderer, const PictureOptions& options, const std::vector<Camera>& cameras) {
  constexpr std::size_t looks = 24;
  std::vector<Camera> some;
  for (std::size_t k = 0; k < std::min(looks, cameras.size()); ++k) {
    some.push_back(cameras[k * cameras.size() / std::min(looks, cameras.size())]);
  }
  return renderer.exposure(options, some);
}

double processor_seconds() {
  struct rusage use {};
  ::getrusage(RUSAGE_SELF, &use);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(use.ru_utime) + seconds(use.ru_stime);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
}

/// What the frames took.
struct Took {
  std::vector<double> render, write, processor;
  std::string text(const PictureOptions& picture, const std::string& exposed) const {
    return fmt::format("picture        {} x {}, {} samples, exposure {:.4g} ({})\n", picture.width, picture.height,
                       picture.samples, *picture.exposure, exposed) +
           fmt::format(
               "frames         {}: {:.3f} s to render and {:.3f} s to write each (medians), {:.3f} s of the "
               "processor\n",
               render.size(), median(render), median(write), median(processor));
  }
};

void write_frame(const Options& options, const Picture& frame, std::uint64_t number) {
  for (const std::string& pattern : options.outputs) {
    const std::string name = options.film() ? frame_name(pattern, number) : pattern;
    extension_of(name) == ".png" ? write_png(frame, frame.tone, name) : write_exr(frame, name);
  }
}

/// Renders and writes the frames from --first on, until the last one or Ctrl-C.
Took make_frames(const Options& options, const Renderer& renderer, PictureOptions picture,
                 const std::vector<Camera>& cameras, Console& console) {
  Took took;
  const bool many = options.film();
  if (many) console.begin("Frames", cameras.size() - options.first);
  for (std::size_t k = options.first; k < cameras.size(); ++k) {
    const Timer rendering;
    const double before = processor_seconds();
    picture.camera = cameras[k];
    const Picture frame = renderer.render(picture, many ? nullptr : &console);
    took.render.push_back(rendering.seconds());
    const Timer writing;
    write_frame(options, frame, k);
    took.write.push_back(writing.seconds());
    took.processor.push_back(processor_seconds() - before);
    if (many) console.advance(1);
    if (console.interrupted()) break;
  }
  if (many) console.end();
  return took;
}

void check(Options& options) {
  if (options.outputs.empty()) {
    const std::string stem = std::filesystem::path(options.scene.file).stem().string();
    options.outputs = {options.film() ? as_pattern(stem) + "-%04d.png" : stem + ".png"};
  }
  if (!options.film() && (options.frames || options.first > 0)) {
    throw Error(ErrorKind::usage, "--frames and --first are for films: --path FILE or --orbit");
  }
  if (options.film()) check_frame_names(options.outputs, true);
  std::vector<std::string> files;
  for (const std::string& output : options.outputs) {
    if (!options.film() && extension_of(output) != ".png" && extension_of(output) != ".exr") {
      throw Error(ErrorKind::usage,
                  fmt::format("-o {}: '{}' is not a picture (.png, .exr)", output, extension_of(output)));
    }
    files.push_back(options.film() ? frame_name(output, options.first) : output);
    const std::string& kept = options.solving.form_factors;
    if (kept.empty() || !same_file(files.back(), kept)) continue;
    throw Error(ErrorKind::usage, fmt::format("{} is the file of form factors: an output would destroy it", output));
  }
  check_files(files, options.scene.file);
  check_picture(options.picture, true);
}

/// After Ctrl-C: how far it came.
int interrupted(const Options& options, const Lit& lit, std::size_t made, std::size_t all) {
  const std::size_t next = options.first + made;
  std::string text = fmt::format("{} of {} frames are written; --first {} goes on", next, all, next);
  if (next >= all) text = "everything is written";
  if (lit.solved && lit.solved->interrupted) {
    text = fmt::format("{} written, from the best so far: {}", options.film() ? "the first frame is" : "the picture is",
                       lit.solved->reason);
  }
  say_error(ErrorKind::interrupted, text);
  return exit_status(ErrorKind::interrupted);
}

int run(Options options) {
  Console console(voice_of(options.scene));
  check(options);
  const std::unique_ptr<Lit> held = look_into(options, console);
  const Lit& lit = *held;
  PictureOptions picture = picture_options(options.picture, lit.camera);
  const Camera usual = lit.renderer->camera(picture);
  const std::vector<Camera> cameras = cameras_of(options, usual, static_cast<double>(picture.width) / picture.height);
  if (options.first >= cameras.size()) {
    throw Error(ErrorKind::usage,
                fmt::format("--first {}: the film has {} frames, from 0 on", options.first, cameras.size()));
  }
  if (options.film()) check_frames_spare(options.outputs, options.first, cameras.size(), lit.inputs);
  console.be_patient("the frame in hand is finished");
  const std::string exposed = picture.exposure ? "as asked"
                              : options.film() ? "automatic, one for all frames"
                                               : "automatic";
  if (!picture.exposure) picture.exposure = film_exposure(*lit.renderer, picture, cameras);
  const Took took = make_frames(options, *lit.renderer, picture, cameras, console);
  if (!options.scene.quiet) {
    fmt::print("{}", took.text(picture, exposed));
    for (const std::string& output : options.outputs) fmt::print("wrote          {}\n", output);
  }
  if (console.interrupted()) return interrupted(options, lit, took.render.size(), cameras.size());
  if (!lit.solved || lit.solved->converged || options.solving.stop.iterations) return 0;
  say_error(ErrorKind::not_converged, lit.solved->reason);
  return exit_status(ErrorKind::not_converged);
}

}  // namespace

void add_render(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("render", "pictures of a solved scene: one, or the frames of a film");
  add_scene_options(command, options->scene,
                    "a solved scene (.glb, written by 'interflect solve'), or a scene, which is solved first");
  command
      .add_option(
          "-o,--output", options->outputs,
          "the picture, .png or .exr; of a film the frames' names, such as frame-%04d.png (may be given several "
          "times; default: the scene's name in this folder)")
      ->type_size(1)
      ->allow_extra_args(false);
  add_picture_options(command, options->picture);
  auto* path =
      command.add_option("--path", options->path, "a film: key cameras in a file, .json or .csv (docs/render.md)")
          ->check(file_name());
  command.add_flag("--orbit", options->orbit, "a film: once around the camera's target")->excludes(path);
  command.add_option("--frames", options->frames, "of the film (default: --orbit 120; --path its time times --fps)")
      ->check(number(0U, 1'000'000U));
  command.add_option("--fps", options->fps, "frames per second of the times in --path")
      ->check(number(0.0, 1000.0))
      ->capture_default_str();
  command.add_option("--first", options->first, "begin with this frame (the first is 0), to go on with a film")
      ->check(count(1'000'000))
      ->capture_default_str();
  add_solving_options(command, options->solving);
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
