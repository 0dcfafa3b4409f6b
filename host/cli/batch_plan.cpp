#include "batch_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "done.h"
#include "interflect/base/error.h"
#include "outputs.h"

namespace interflect::cli {

namespace {

/// Of a run, not of a job.
constexpr std::array for_the_run{"help", "manifest", "summary", "force", "quiet", "json-progress"};

void replace_all(std::string& text, std::string_view from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
}

std::string expanded(std::string text, const std::filesystem::path& scene) {
  const std::string folder = scene.parent_path().string();
  replace_all(text, "{name}", scene.stem().string());
  replace_all(text, "{folder}", folder.empty() ? "." : folder);
  return text;
}

/// One and the same text for one and the same file, however it is spelled.
std::string identity(const std::string& path) {
  std::error_code missing;
  return std::filesystem::weakly_canonical(std::filesystem::absolute(path, missing), missing).string();
}

std::vector<std::string> written_by(const PlannedJob& planned) {
  std::vector<std::string> files = outputs_of(planned.job);
  if (!planned.job.checkpoint.file.empty()) files.push_back(planned.job.checkpoint.file);
  if (const std::string note = done_file(planned.job); !note.empty()) files.push_back(note);
  return files;
}

}  // namespace

GivenOptions given_options(const CLI::App& command) {
  GivenOptions given;
  for (const CLI::Option* option : command.get_options()) {
    if (option->count() == 0 || option->get_lnames().empty()) continue;  // also the scenes
    const std::string& name = option->get_lnames().front();
    if (std::find(for_the_run.begin(), for_the_run.end(), name) != for_the_run.end()) continue;
    const bool flag = option->get_items_expected_max() == 0;
    given[name] = flag ? std::vector<std::string>{} : option->results();
  }
  return given;
}

PlannedJob plan_job(const std::string& scene, const GivenOptions& options, const std::string& where) {
  PlannedJob planned;
  planned.where = where;
  CLI::App app("a job", where);
  app.set_help_flag();
  add_scene_options(app, planned.job.scene);
  add_job_options(app, planned.job);
  std::vector<std::string> words;
  for (const auto& [name, values] : options) {
    if (values.empty()) words.push_back("--" + name);
    for (const std::string& value : values) {
      planned.options[name].push_back(expanded(value, scene));
      const std::string& word = planned.options[name].back();
      if (word.starts_with('-') || app.get_option("--" + name)->get_items_expected_max() == 0) {
        words.push_back(fmt::format("--{}={}", name, word));
      } else {
        words.insert(words.end(), {"--" + name, word});
      }
    }
    if (values.empty()) planned.options[name] = {};
  }
  words.insert(words.end(), {"--", scene});
  std::reverse(words.begin(), words.end());  // as CLI11 wants them
  try {
    app.parse(std::move(words));
  } catch (const CLI::ParseError& error) {
    std::string message = error.what();
    std::replace(message.begin(), message.end(), '\n', ' ');
    throw Error(ErrorKind::usage, fmt::format("{}: {}", where, message));
  }
  planned.job.lamps_asked = app.count("--light-groups") > 0;
  planned.job.tell = false;
  return planned;
}

std::vector<PlannedJob> plan_scenes(const std::vector<std::string>& scenes, const GivenOptions& options) {
  std::vector<PlannedJob> jobs;
  for (const std::string& scene : scenes) {
    jobs.push_back(plan_job(scene, options, fmt::format("job {} ({})", jobs.size() + 1, scene)));
  }
  return jobs;
}

void check_plan(const std::vector<PlannedJob>& jobs, const std::vector<std::string>& others) {
  std::map<std::string, std::size_t> writers;  // the first job that writes a file
  for (std::size_t k = 0; k < jobs.size(); ++k) {
    try {
      check_job(jobs[k].job);
    } catch (const Error& error) {
      // What cannot be written, or is not there, is this job's own failure.
      if (error.kind() != ErrorKind::usage) continue;
      throw Error(ErrorKind::usage, fmt::format("{}: {}", jobs[k].where, error.what()));
    }
  }
  for (std::size_t k = 0; k < jobs.size(); ++k) {
    for (const std::string& file : written_by(jobs[k])) {
      const auto [at, first] = writers.emplace(identity(file), k);
      if (!first && at->second == k && identity(file) == identity(done_file(jobs[k].job))) {
        throw Error(ErrorKind::usage, fmt::format("{}: {} is the note that says that the job is done", jobs[k].where, file));
      }
      if (first || at->second == k) continue;
      throw Error(ErrorKind::usage,
                  fmt::format("{}: {} is written by {}, too: {{name}} in a file's name stands for the "
                              "scene's, {{folder}} for its folder",
                              jobs[k].where, file, jobs[at->second].where));
    }
  }
  const auto refuse = [&](const PlannedJob& job, const std::string& file) {
    const auto at = file.empty() ? writers.end() : writers.find(identity(file));
    if (at == writers.end() || &jobs[at->second] == &job) return;
    throw Error(ErrorKind::usage, fmt::format("{}: {} is read, and {} writes it: jobs must not depend on each other",
                                              job.where, file, jobs[at->second].where));
  };
  for (const PlannedJob& job : jobs) {
    refuse(job, job.job.scene.file);
    refuse(job, job.job.solving.form_factors);
  }
  for (const std::string& file : others) {
    const auto at = file.empty() ? writers.end() : writers.find(identity(file));
    if (at == writers.end()) continue;
    throw Error(ErrorKind::usage, fmt::format("{}: {} is used by the run itself", jobs[at->second].where, file));
  }
}

}  // namespace interflect::cli
