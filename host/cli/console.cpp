#include "console.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "launch.h"

namespace interflect::cli {

namespace {

constexpr std::uint64_t marks = 8;              // a bar is also drawn at every eighth of its stage
constexpr double redraw = 0.1;                  // seconds
constexpr std::uint32_t each_iteration = 1000;  // so many are told to programs one by one

/// A Console speaks JSON: then what main() says is JSON as well.
bool speaks_json = false;

std::string_view name_of(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::internal: return "internal";
    case ErrorKind::usage: return "usage";
    case ErrorKind::input: return "input";
    case ErrorKind::device: return "device";
    case ErrorKind::not_converged: return "not converged";
    case ErrorKind::limit: return "limit";
    case ErrorKind::interrupted: return "interrupted";
  }
  return "internal";
}

void print_json(const nlohmann::ordered_json& object) {
  fmt::print(stderr, "{}\n", object.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
  std::fflush(stderr);
}

/// Of the terminal, less one so that no line wraps.
std::size_t columns() {
  constexpr std::size_t fewest = 20, usual = 80;
  struct winsize size {};
  const bool known = ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return std::max(fewest, known ? std::size_t{size.ws_col} : usual) - 1;
}

}  // namespace

Console::Console(Voice voice) : voice_(voice), terminal_(voice == Voice::people && ::isatty(STDERR_FILENO) == 1) {
  speaks_json = voice == Voice::json;
}

Console::~Console() {
  erase();
}

void Console::begin(std::string_view stage, std::uint64_t total) {
  const std::lock_guard lock(mutex_);
  stage_ = stage;
  total_ = total;
  done_ = 0;
  iteration_ = 0;
  iterating_ = false;
  next_ = 0;
  running_ = true;
  timer_.restart();
  show("begin");
}

void Console::advance(std::uint64_t steps) {
  const std::uint64_t done = done_ += steps;
  if ((!terminal_ && voice_ != Voice::json) || iterating_) return;  // iteration() follows
  const double now = timer_.seconds();
  double due = next_;
  const bool passes_mark = total_ >= marks && done * marks / total_ > (done - steps) * marks / total_;
  if (passes_mark) due = next_ = now;
  // One of the threads that find the bar due draws it; the others go on with their work.
  if (now < due || !next_.compare_exchange_strong(due, now + redraw)) return;
  const std::lock_guard lock(mutex_);
  show("running");
}

void Console::iteration(std::uint32_t number, double residual) {
  if (!patient_) {
    be_patient(ranks().size() > 1 ? "mpirun ends the job; the best result so far is written if all ranks are there"
                                  : "the best result so far is written");
  }
  if (!terminal_ && voice_ != Voice::json) return;
  const std::lock_guard lock(mutex_);
  iteration_ = number;
  residual_ = residual;
  iterating_ = true;
  const double now = timer_.seconds();
  if (now < next_ && number > (voice_ == Voice::json ? each_iteration : 1)) return;
  next_ = now + redraw;
  show("running");
}

bool Console::interrupted() {
  return patient_ && PatientInterrupt::asked();
}

void Console::be_patient(const std::string& promise) {
  if (interrupted()) return;
  patient_.reset();
  line_ = fmt::format("interrupted: {} (once more to end at once)", promise);
  line_ = voice_ == Voice::json ? nlohmann::ordered_json{{"message", line_}}.dump() + "\n"
                                : fmt::format("{}interflect: {}\n", terminal_ ? "\r\x1b[K" : "", line_);
  if (!speaks()) line_.clear();
  patient_.emplace(line_);
}

StageState Console::state() const {
  return {stage_,     total_ == 0 ? done_.load() : std::min<std::uint64_t>(done_, total_),
          total_,     timer_.seconds(),
          iteration_, residual_,
          job_,       jobs_};
}

void Console::show(std::string_view moment) {
  if (voice_ == Voice::json) return print_json(progress_json(state(), moment));
  if (!terminal_) return;
  fmt::print(stderr, "\r\x1b[K{}", bar_line(state(), columns()));
  std::fflush(stderr);
  drawn_ = true;
}

void Console::erase() {
  if (!drawn_) return;
  std::fputs("\r\x1b[K", stderr);
  std::fflush(stderr);
  drawn_ = false;
}

void Console::end() {
  const std::lock_guard lock(mutex_);
  if (voice_ == Voice::json && running_) show("end");
  running_ = false;
  erase();
}

void Console::message(std::string_view line) {
  if (voice_ == Voice::quiet) return;
  const std::lock_guard lock(mutex_);
  if (voice_ == Voice::json) return print_json({{"message", std::string(line)}});
  erase();
  fmt::print(stderr, "interflect: {}\n", line);
}

void say_error(ErrorKind kind, std::string_view message) {
  const std::string_view name = name_of(kind);
  if (speaks_json) {
    return print_json({{"error", std::string(message)}, {"kind", std::string(name)}, {"status", exit_status(kind)}});
  }
  const bool plain = kind == ErrorKind::interrupted || kind == ErrorKind::not_converged;
  fmt::print(stderr, "interflect: {}: {}\n", plain ? name : "error", message);
}

}  // namespace interflect::cli
