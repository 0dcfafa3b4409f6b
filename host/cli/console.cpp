#include "console.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace interflect::cli {

namespace {

constexpr double redraw = 0.1;  // seconds

std::string duration(double seconds) {
  if (seconds < 60) return fmt::format("{:.0f} s", seconds);
  const auto whole = static_cast<std::uint64_t>(seconds);
  if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  return fmt::format("{} h {:02} min", whole / 3600, whole / 60 % 60);
}

}  // namespace

Console::Console(bool quiet) : quiet_(quiet), terminal_(!quiet && ::isatty(STDERR_FILENO) == 1) {}

Console::~Console() {
  if (drawn_) std::fputs("\r\x1b[K", stderr);
}

void Console::begin(std::string_view stage, std::uint64_t total) {
  stage_ = stage;
  total_ = total;
  done_ = 0;
  next_ = redraw;
  timer_.restart();
}

void Console::advance(std::uint64_t steps) {
  done_ += steps;
  if (!terminal_) return;
  const double now = timer_.seconds();
  double due = next_;
  // One of the threads that find the bar due draws it; the others go on with their work.
  if (now < due || !next_.compare_exchange_strong(due, now + redraw)) return;
  const std::lock_guard lock(mutex_);
  draw(now);
}

void Console::draw(double seconds) {
  constexpr int width = 30;
  const std::uint64_t done = std::min<std::uint64_t>(done_, total_);
  const double share = total_ == 0 ? 0 : static_cast<double>(done) / static_cast<double>(total_);
  const int filled = static_cast<int>(share * width);
  const std::string left = share > 0.01 ? duration(seconds / share * (1 - share)) + " left" : "";
  fmt::print(stderr, "\r\x1b[K{:<14} [{}{}] {:3.0f} %  {}", stage_, std::string(static_cast<std::size_t>(filled), '#'),
             std::string(static_cast<std::size_t>(width - filled), '.'), share * 100, left);
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
  erase();
}

void Console::message(std::string_view line) {
  if (quiet_) return;
  const std::lock_guard lock(mutex_);
  erase();
  fmt::print(stderr, "interflect: {}\n", line);
}

}  // namespace interflect::cli
