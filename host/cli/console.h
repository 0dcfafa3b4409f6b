#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/progress.h"
#include "interflect/base/timer.h"
#include "progress_line.h"

namespace interflect::cli {

/// How stderr is used.
enum class Voice {
  people,  ///< a bar with rate and time left on a terminal, nothing elsewhere; messages as "interflect: warning: ..."
  quiet,   ///< neither bars nor messages
  json,    ///< --json-progress: one JSON object per line, see docs/progress.md
};

/// Progress on stderr. From the solver's first iteration on, the first Ctrl-C is kept as interrupted(), so that the
/// best result so far can be written; the second one ends the program.
class Console : public ProgressSink {
 public:
  explicit Console(bool quiet) : Console(quiet ? Voice::quiet : Voice::people) {}
  explicit Console(Voice voice);
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;
  ~Console() override;

  void begin(std::string_view stage, std::uint64_t total) override;
  void advance(std::uint64_t steps) override;
  void end() override;
  void message(std::string_view line) override;
  void iteration(std::uint32_t number, double residual) override;
  [[nodiscard]] bool interrupted() override;

  /// What follows belongs to job number `job` of `jobs`: bars and JSON say so.
  void set_job(std::uint32_t job, std::uint32_t jobs) {
    job_ = job;
    jobs_ = jobs;
  }

  /// From now on the first Ctrl-C is kept as interrupted(). `promise` says what is still done then, in a few words of
  /// the program's own.
  void be_patient(const std::string& promise);

 private:
  [[nodiscard]] StageState state() const;
  void show(std::string_view moment);
  void erase();

  Voice voice_;
  bool terminal_;
  bool drawn_ = false;
  bool running_ = false;  ///< between begin() and end()
  std::string stage_;
  std::uint32_t job_ = 0, jobs_ = 0;
  std::uint64_t total_ = 0;
  std::atomic<std::uint64_t> done_{0};
  std::uint32_t iteration_ = 0;
  std::atomic<bool> iterating_{false};
  double residual_ = 0;
  std::atomic<double> next_{0};  ///< when the bar is drawn next, seconds since begin()
  Timer timer_;
  std::mutex mutex_;  ///< of everything that is drawn
  std::string line_;  ///< what Ctrl-C says; before patient_, which points into it
  std::optional<PatientInterrupt> patient_;
};

/// What ends the program, on stderr: "interflect: error: MESSAGE" ("interflect: interrupted: MESSAGE"), or an object
/// with error, kind and status where a Console speaks JSON.
void say_error(ErrorKind kind, std::string_view message);

}  // namespace interflect::cli
