#include "solve.h"

#include <memory>
#include <string>
#include <vector>

#include "batch.h"
#include "batch_plan.h"
#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "launch.h"
#include "solve_job.h"
#include "validators.h"

namespace interflect::cli {

namespace {

int run(const SolveJob& job) {
  Console console(voice_of(job.scene));
  const JobEnd end = solve_job(job, console);
  if (end.failure && speaks()) say_error(*end.failure, end.reason);
  return end.status;
}

/// What `solve` has beside the options of a job.
struct SolveCommand {
  SolveJob job;
  std::vector<std::string> scenes;
  std::string manifest;
  BatchOptions batch;
};

int run(SolveCommand& command, const GivenOptions& given) {
  const bool several = command.scenes.size() > 1 || !command.manifest.empty();
  if (command.manifest.empty() == command.scenes.empty()) {
    throw Error(ErrorKind::usage, command.scenes.empty()
                                      ? "a scene is needed, or --manifest (see 'interflect solve --help')"
                                      : "--manifest names the scenes: give either");
  }
  if (!several && (command.batch.force || !command.batch.summary.empty())) {
    throw Error(ErrorKind::usage, "--force and --summary are for several scenes");
  }
  if (several && ranks().size() > 1) {
    throw AgreedError(ErrorKind::usage, "several scenes: not on several ranks yet: start it without mpirun");
  }
  if (!several) {
    SolveJob job = plan_job(command.scenes.front(), given, command.scenes.front()).job;
    job.tell = true;
    job.scene.quiet = command.job.scene.quiet;
    job.scene.json_progress = command.job.scene.json_progress;
    return run(job);
  }
  command.batch.quiet = command.job.scene.quiet;
  command.batch.voice = voice_of(command.job.scene);
  const Console console(command.batch.voice);  // errors speak as it does
  std::vector<PlannedJob> jobs =
      command.manifest.empty() ? plan_scenes(command.scenes, given) : plan_manifest(command.manifest, given);
  check_plan(jobs, {command.manifest, command.batch.summary});
  return run_batch(std::move(jobs), command.batch);
}

}  // namespace

void add_solve(CLI::App& program, Action& action) {
  auto solve = std::make_shared<SolveCommand>();
  solve->job.light_groups = "none";  // as --help says
  CLI::App& command = *program.add_subcommand("solve", "solve scenes and write their light");
  add_scene_options(command, solve->job.scene);
  CLI::Option* const one = command.get_option("SCENE");
  const std::string what = one->get_description();
  command.remove_option(one);
  command.add_option("SCENE", solve->scenes,
                     what +
                         "; several are solved one after the other, then {name} and {folder} in "
                         "the names of outputs stand for the scene's");
  add_job_options(command, solve->job);
  command.add_option("--manifest", solve->manifest, "scenes, outputs and options from this file (docs/batch.md)")
      ->check(file_name());
  command.add_option("--summary", solve->batch.summary, "of several scenes: how each ended, as JSON")
      ->check(file_name());
  command.add_flag("--force", solve->batch.force, "of several scenes: solve also what is done");
  command.callback(
      [solve, &action, &command] { action = [solve, given = given_options(command)] { return run(*solve, given); }; });
}

void add_solving(CLI::App& program, Action& action, const SolvingCommand& which) {
  auto job = std::make_shared<SolveJob>();
  job->page = which.page;
  job->light_groups = which.page ? "auto" : "none";  // as --help says
  CLI::App& command = *program.add_subcommand(which.name, which.description);
  add_scene_options(command, job->scene);
  add_job_options(command, *job);
  command.callback([job, &action, &command] {
    job->lamps_asked = command.count("--light-groups") > 0;
    action = [job] {
      if (job->page) ask_for_page(*job);
      return run(*job);
    };
  });
}

}  // namespace interflect::cli
