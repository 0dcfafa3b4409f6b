#include "solve_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/timer.h"
#include "interflect/output/lightmap.h"
#include "kept.h"
#include "launch.h"
#include "outputs.h"
#include "page.h"
#include "place.h"
#include "report.h"
#include "validators.h"

namespace interflect::cli {

namespace {

constexpr std::array extensions{".png", ".exr", ".ply", ".glb", ".csv", ".npy", ".html", ".json"};

bool has_page(const SolveJob& job) {
  const auto is_page = [](const std::string& file) { return extension_of(file) == ".html"; };
  return std::any_of(job.outputs.begin(), job.outputs.end(), is_page);
}

bool is_picture(const std::string& path) {
  return extension_of(path) == ".png" || extension_of(path) == ".exr";
}

/// Everything about the outputs that can be wrong before the work starts.
void check_outputs(const SolveJob& job) {
  std::vector<std::string> files = outputs_of(job);
  for (const std::string& file : job.outputs) {
    if (std::find(extensions.begin(), extensions.end(), extension_of(file)) == extensions.end()) {
      throw Error(ErrorKind::usage,
                  fmt::format("-o {}: '{}' is not an output format (.png, .exr, .ply, .glb, .csv, .npy, .html, .json)",
                              file, extension_of(file)));
    }
  }
  check_lightmap(job.lightmap, job.outputs);
  // A file of form factors is read where it is there.
  std::error_code missing;
  const std::string& kept = job.solving.form_factors;
  if (!kept.empty() && !std::filesystem::exists(kept, missing)) files.push_back(kept);
  if (!job.checkpoint.file.empty()) files.push_back(job.checkpoint.file);
  check_files(files, job.scene.file);
  for (const std::string& file : result_files(job)) {
    if (kept.empty() || !same_file(file, kept)) continue;
    throw Error(ErrorKind::usage, fmt::format("{} is the file of form factors: an output would destroy it", file));
  }
}

void check_scene_stays(const SolveJob& job, const Scene& scene) {
  std::vector<std::string> outputs = outputs_of(job);
  if (!job.solving.form_factors.empty()) outputs.push_back(job.solving.form_factors);
  if (!job.checkpoint.file.empty()) outputs.push_back(job.checkpoint.file);
  check_inputs_stay(outputs, scene.files);
}

void write_outputs(const SolveJob& job, const SolveSummary& summary, const PlacedSolve& placed,
                   std::optional<Atlas> atlas, ProgressSink& progress) {
  const MeshedScene& loaded = *summary.loaded;
  const Solution solution = solution_of(loaded, placed);
  const PictureOptions picture = picture_options(job.picture, loaded.scene.camera);
  std::optional<Lightmap> lightmap;
  if (atlas) lightmap = bake_lightmap(solution, std::move(*atlas));
  for (const std::string& file : job.lightmap.images) write_lightmap(*lightmap, file);
  std::optional<Picture> rendered;  // one for .png and .exr together
  if (std::any_of(job.outputs.begin(), job.outputs.end(), is_picture)) {
    rendered = render(solution, picture, &progress);
  }
  progress.begin("Write", job.outputs.size());
  for (const std::string& file : job.outputs) {
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

/// For people: where the pages are, as a browser takes it.
void tell_pages(const SolveJob& job) {
  for (const std::string& file : job.outputs) {
    if (extension_of(file) != ".html") continue;
    fmt::print("open           {}\n", std::filesystem::absolute(file).lexically_normal().string());
  }
}

/// What was asked for, as a summary of how it went.
SolveSummary summary_of(const SolveJob& job, const MeshedScene& loaded, const PlacedSolve& placed) {
  const AssemblyReport& assembled = placed.factors.report;
  SolveSummary summary{&loaded,          &assembled,    &placed.solved, job.solving.chosen_method(),
                       job.solving.stop, placed.energy, placed.assembly};
  summary.kept = placed.kept;
  summary.ranks = placed.ranks;
  const Timer estimating;
  summary.row_error = row_sum_error(assembled.tile_variance, loaded.mesh.area);
  summary.radiosity_error =
      radiosity_error(assembled.tile_variance, loaded.mesh.area, loaded.mesh.reflectance, placed.solved.radiosity);
  summary.estimate_seconds = estimating.seconds();
  return summary;
}

void write_reports(const SolveJob& job, const SolveSummary& summary) {
  for (const std::string& file : job.outputs) {
    if (extension_of(file) == ".json") write_report(summary, file);
  }
  if (!job.report.empty()) write_report(summary, job.report);
}

void tell(const SolveJob& job, const SolveSummary& summary, const std::optional<Atlas>& atlas) {
  fmt::print("{}", to_text(summary));
  if (atlas) fmt::print("{}", lightmap_line(*atlas));
  for (const std::string& file : result_files(job)) fmt::print("wrote          {}\n", file);
  if (!job.report.empty()) fmt::print("wrote          {}\n", job.report);
  tell_pages(job);
}

/// The status, and why it is not 0.
JobEnd end_of(const SolveJob& job, const Solved& solved, bool interrupted) {
  const SolveReport& report = solved.report;
  JobEnd end;
  // Of a fixed number of iterations some are missing then, whatever the residual.
  end.whole = job.solving.stop.iterations ? !report.interrupted : report.converged;
  if (solved.lost) {
    end.whole = false;
    end.fail(solved.lost->kind(),
             fmt::format("{}; what was asked for is written from the last iterate, {}", first_line(solved.lost->what()),
                         report.converged ? "which has converged" : "which has not converged"));
  } else if (interrupted) {
    end.fail(ErrorKind::interrupted,
             report.interrupted ? fmt::format("what was asked for is written from the best so far: {}", report.reason)
                                : "the solve was done, and what was asked for is written");
  } else if (!end.whole) {
    end.fail(ErrorKind::not_converged, report.reason);
  }
  return end;
}

}  // namespace

void JobEnd::fail(ErrorKind kind, const std::string& why) {
  failure = kind;
  status = exit_status(kind);
  reason = why;
}

std::vector<std::string> result_files(const SolveJob& job) {
  std::vector<std::string> files = job.outputs;
  files.insert(files.end(), job.lightmap.images.begin(), job.lightmap.images.end());
  return files;
}

std::vector<std::string> outputs_of(const SolveJob& job) {
  std::vector<std::string> files = result_files(job);
  if (!job.report.empty()) files.push_back(job.report);
  return files;
}

void ask_for_page(SolveJob& job) {
  if (has_page(job)) return;
  if (!job.outputs.empty()) {
    throw Error(ErrorKind::usage, fmt::format("-o {}: view writes a page, which ends in .html", job.outputs.front()));
  }
  job.outputs.push_back(std::filesystem::path(job.scene.file).stem().string() + ".html");
}

void check_job(const SolveJob& job) {
  check_outputs(job);
  check_picture(job.picture, std::any_of(job.outputs.begin(), job.outputs.end(), is_picture));
}

JobEnd solve_job(const SolveJob& job, Console& console, DevicePool* pool) {
  const Timer total;
  Candidates candidates = together([&] {
    if (speaks()) check_job(job);
    Candidates asked =
        pool != nullptr
            ? pool->candidates(job.solving.device, console,
                               [&](std::size_t devices) { return together_of(job.solving, devices); })
            : candidates_of(job.solving, console);
    asked.open();  // a device that is not there is found before the work, too
    return asked;
  });
  const SceneOptions as_kept = together([&] { return with_the_files_divide(job.scene, job.solving.form_factors); });
  const MeshedScene loaded = together([&] {
    MeshedScene read = load(as_kept, console);
    check_scene_stays(job, read.scene);
    return read;
  });
  if (job.read) job.read(loaded.scene);
  // A page is for dimming lamps; without one they are told apart only where that is asked for.
  const std::string lamps_by = job.lamps_asked ? job.light_groups : has_page(job) ? "auto" : "none";
  Lamps lamps{light_groups(loaded.scene, loaded.mesh, lamps_by)};
  if (has_page(job)) lamps.bounces = bounces_for_page(loaded.mesh.size(), lamps.groups.names.size());
  // Of several ranks rank 0 has the files.
  const std::optional<Atlas> atlas = !speaks() ? std::nullopt : lightmap_atlas(job.lightmap, loaded.mesh, console);
  std::optional<CheckpointFile> checkpoint;
  agreed(ranks(), [&] {
    if (job.checkpoint.file.empty() || !speaks()) return;
    const IterateKey key = key_of(loaded, lamps, as_kept, job.solving);
    candidates.keep_in(&checkpoint.emplace(job.checkpoint, key, job.solving.stop, console));
  });
  const PlacedSolve placed = solve_loaded(loaded, as_kept, job.solving, candidates, console, lamps);
  if (!speaks()) return end_of(job, placed.solved, placed.solved.report.interrupted);

  SolveSummary summary = summary_of(job, loaded, placed);
  const Timer writing;
  write_outputs(job, summary, placed, atlas, console);
  summary.write_seconds = writing.seconds();
  JobEnd end = end_of(job, placed.solved, console.interrupted());
  if (checkpoint) {
    // Before the report, which says so; a report that cannot be written costs a solve.
    if (end.whole) checkpoint->remove();
    summary.checkpoint = checkpoint->use();
  }
  summary.total_seconds = total.seconds();
  write_reports(job, summary);
  if (job.tell && !job.scene.quiet) tell(job, summary, atlas);
  end.patches = loaded.mesh.size();
  end.iterations = placed.solved.report.iterations;
  end.devices = placed.solved.devices;
  return end;
}

void add_job_options(CLI::App& command, SolveJob& job) {
  command
      .add_option("-o,--output", job.outputs,
                  job.page
                      ? "the page, .html (default: the scene's name in this folder), and what else solve writes"
                      : "output, by extension: .png .exr .ply .glb .csv .npy .html .json (may be given several times)")
      ->type_size(1)
      ->allow_extra_args(false);
  add_lightmap_options(command, job.lightmap);
  command.add_option("--report", job.report, "the report as JSON")->check(file_name());
  add_solving_options(command, job.solving);
  add_checkpoint_options(command, job.checkpoint);
  add_light_groups_option(command, job.light_groups);
  add_picture_options(command, job.picture);
}

}  // namespace interflect::cli
