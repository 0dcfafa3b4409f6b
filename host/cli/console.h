#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>

#include "interflect/base/progress.h"
#include "interflect/base/timer.h"

namespace interflect::cli {

/// Progress on stderr: a bar with the time left on a terminal, nothing elsewhere; messages as "interflect: warning:
/// ...".
class Console : public ProgressSink {
 public:
  /// quiet: neither bars nor messages.
  explicit Console(bool quiet);
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;
  ~Console() override;

  void begin(std::string_view stage, std::uint64_t total) override;
  void advance(std::uint64_t steps) override;
  void end() override;
  void message(std::string_view line) override;

 private:
  void draw(double seconds);
  void erase();

  bool quiet_;
  bool terminal_;
  bool drawn_ = false;
  std::string stage_;
  std::uint64_t total_ = 0;
  std::atomic<std::uint64_t> done_{0};
  std::atomic<double> next_{0};  ///< when the bar is drawn next, seconds since begin()
  Timer timer_;
  std::mutex mutex_;  ///< of everything that is drawn
};

}  // namespace interflect::cli
