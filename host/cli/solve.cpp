#include "solve.h"

#include <memory>

#include "commands.h"
#include "console.h"
#include "solve_job.h"

namespace interflect::cli {

namespace {

int run(SolveJob job) {
  if (job.page) ask_for_page(job);
  Console console(voice_of(job.scene));
  const JobEnd end = solve_job(job, console);
  if (end.failure) say_error(*end.failure, end.reason);
  return end.status;
}

}  // namespace

void add_solve(CLI::App& program, Action& action) {
  add_solving(program, action, {"solve", "solve a scene and write its light"});
}

void add_solving(CLI::App& program, Action& action, const SolvingCommand& which) {
  auto job = std::make_shared<SolveJob>();
  job->page = which.page;
  job->light_groups = which.page ? "auto" : "none";  // as --help says
  CLI::App& command = *program.add_subcommand(which.name, which.description);
  add_scene_options(command, job->scene);
  add_job_options(command, *job);
  command.callback([job, &action, &command] {
    if (command.count("--light-groups") == 0) job->light_groups.clear();
    action = [job] { return run(*job); };
  });
}

}  // namespace interflect::cli
