#include "batch.h"

#include <fmt/format.h>

#include <algorithm>
#include <new>

#include "done.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/last_words.h"
#include "interflect/base/timer.h"
#include "report.h"

namespace interflect::cli {

namespace {

using nlohmann::ordered_json;

enum class Result { not_begun, done, skipped, failed, not_converged, interrupted };

struct Row {
  Result result = Result::not_begun;
  JobEnd end = {};
  double seconds = 0;
};

std::string_view name_of(Result result) {
  switch (result) {
    case Result::not_begun: return "not done";
    case Result::done: return "done";
    case Result::skipped: return "skipped";
    case Result::failed: return "failed";
    case Result::not_converged: return "not converged";
    case Result::interrupted: return "interrupted";
  }
  return "?";
}

Result result_of(const JobEnd& end) {
  if (!end.failure || end.whole) return Result::done;  // whole and interrupted: the user ended what came after
  if (*end.failure == ErrorKind::interrupted) return Result::interrupted;
  return *end.failure == ErrorKind::not_converged ? Result::not_converged : Result::failed;
}

class Batch {
 public:
  Batch(std::vector<PlannedJob> jobs, const BatchOptions& options)
      : jobs_(std::move(jobs)), options_(options), rows_(jobs_.size()) {}

  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;
  ~Batch() { set_last_words(""); }

  int run() {
    write_summary();  // where that cannot be, nothing is begun
    for (std::size_t k = 0; k < jobs_.size() && !interrupted_; ++k) {
      run_one(k);
      try {
        write_summary();
      } catch (const Error& error) {  // such as a full disk: the other jobs and the table do not depend on it
        say_error(error.kind(), error.what());
        summary_failed_ = exit_status(error.kind());
      }
    }
    set_last_words("");
    if (!options_.quiet) print_table();
    return status();
  }

 private:
  void run_one(std::size_t k) {
    PlannedJob& planned = jobs_[k];
    Row& row = rows_[k];
    const Timer timer;
    const std::string who = fmt::format("job {} of {} ({})", k + 1, jobs_.size(), planned.job.scene.file);
    prepare_last_words(k);
    Console console(options_.voice);
    console.set_job(static_cast<std::uint32_t>(k + 1), static_cast<std::uint32_t>(jobs_.size()));
    if (!options_.force && is_done(planned)) {
      row.result = Result::skipped;
      console.message(fmt::format("{}: done before, skipped", who));
      return;
    }
    console.message(who);
    row.end = solve(planned, console);
    row.result = result_of(row.end);
    row.seconds = timer.seconds();
    interrupted_ = row.end.failure == ErrorKind::interrupted || console.interrupted();
    if (row.end.failure) say_error(*row.end.failure, fmt::format("{}: {}", who, row.end.reason));
  }

  /// Whatever happens to one job, the others go on.
  JobEnd solve(PlannedJob& planned, Console& console) {
    JobEnd end;
    ordered_json from;
    planned.job.read = [&](const Scene& scene) {
      try {
        from = made_from(planned, scene);
      } catch (const Error&) {  // gone since it was read: the job goes on, and no note says that it is done
      }
    };
    try {
      end = solve_job(planned.job, console, &pool_);
    } catch (const Error& error) {
      end.fail(error.kind(), error.what());
    } catch (const std::bad_alloc&) {
      end.fail(ErrorKind::limit, "out of memory");
    } catch (const std::exception& error) {
      end.fail(ErrorKind::internal, error.what());
    }
    planned.job.read = {};
    if (!end.whole || from.is_null() || done_file(planned.job).empty()) return end;
    try {
      note_done(planned, from);
    } catch (const Error& error) {
      console.message(fmt::format("warning: {}: a rerun will solve this job again", error.what()));
    }
    return end;
  }

  /// Before the solver's first iteration Ctrl-C ends the program at once.
  void prepare_last_words(std::size_t k) {
    const std::string words = fmt::format("interrupted in job {} of {} ({}): it and the {} after it are not done",
                                          k + 1, jobs_.size(), jobs_[k].job.scene.file, jobs_.size() - k - 1);
    std::string line =
        options_.voice == Voice::json
            ? ordered_json{{"message", words}}.dump(-1, ' ', false, ordered_json::error_handler_t::replace) + "\n"
            : fmt::format("\ninterflect: {}\n", words);
    set_last_words("");
    last_words_ = std::move(line);
    set_last_words(last_words_);
  }

  [[nodiscard]] int status() const {
    if (interrupted_) return exit_status(ErrorKind::interrupted);
    const auto bad = std::find_if(rows_.begin(), rows_.end(), [](const Row& row) { return row.end.status != 0; });
    return bad == rows_.end() ? summary_failed_ : bad->end.status;
  }
  [[nodiscard]] std::size_t count(Result result) const {
    return static_cast<std::size_t>(
        std::count_if(rows_.begin(), rows_.end(), [&](const Row& row) { return row.result == result; }));
  }

  void print_table() const {
    std::size_t width = 5;
    for (const PlannedJob& planned : jobs_) width = std::max(width, planned.job.scene.file.size());
    fmt::print("{:>4}  {:<{}}  {:<13}  {:>6}  {:>8}  {:>10}  {:>8}\n", "job", "scene", width, "result", "status",
               "patches", "iterations", "seconds");
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const Row& row = rows_[k];
      const bool ran = row.result != Result::skipped && row.result != Result::not_begun;
      const bool solved = ran && row.end.patches > 0;
      fmt::print("{:>4}  {:<{}}  {:<13}  {:>6}  {:>8}  {:>10}  {:>8}{}\n", k + 1, jobs_[k].job.scene.file, width,
                 name_of(row.result), row.result == Result::not_begun ? "-" : std::to_string(row.end.status),
                 solved ? std::to_string(row.end.patches) : "-", solved ? std::to_string(row.end.iterations) : "-",
                 ran ? fmt::format("{:.2f}", row.seconds) : "-",
                 row.end.reason.empty() ? "" : fmt::format("  {}", first_line(row.end.reason)));
    }
    std::string totals;
    for (const Result result : {Result::done, Result::skipped, Result::failed, Result::not_converged,
                                Result::interrupted, Result::not_begun}) {
      if (count(result) > 0)
        totals += fmt::format("{}{} {}", totals.empty() ? "" : ", ", count(result), name_of(result));
    }
    fmt::print("{} jobs: {}\n", jobs_.size(), totals);
  }

  void write_summary() const {
    if (options_.summary.empty()) return;
    ordered_json out;
    out["interflect"] = INTERFLECT_VERSION;
    out["status"] = status();
    out["jobs"] = ordered_json::array();
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const Row& row = rows_[k];
      const bool begun = row.result != Result::not_begun;
      out["jobs"].push_back({{"scene", jobs_[k].job.scene.file},
                             {"result", std::string(name_of(row.result))},
                             {"status", begun ? ordered_json(row.end.status) : ordered_json(nullptr)},
                             {"reason", row.end.reason.empty() ? ordered_json(nullptr) : ordered_json(row.end.reason)},
                             {"patches", row.end.patches},
                             {"iterations", row.end.iterations},
                             {"devices", row.end.devices},
                             {"seconds", row.seconds},
                             {"outputs", outputs_of(jobs_[k].job)}});
    }
    AtomicFile file(options_.summary);
    file.write(dump(out));
    file.commit();
  }

  std::vector<PlannedJob> jobs_;
  const BatchOptions& options_;
  std::vector<Row> rows_;
  DevicePool pool_;
  std::string last_words_;
  bool interrupted_ = false;
  int summary_failed_ = 0;  ///< the status of the last failure to write it; 0: none
};

}  // namespace

int run_batch(std::vector<PlannedJob> jobs, const BatchOptions& options) {
  return Batch(std::move(jobs), options).run();
}

}  // namespace interflect::cli
