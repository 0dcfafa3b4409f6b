#pragma once

#include <cstdint>
#include <string_view>

namespace interflect {

/// Where long work reports how far it is. The default does nothing; the command line draws bars on a terminal.
/// begin() and end() come from one thread; advance() may come from any thread at any time in between.
class ProgressSink {
 public:
  ProgressSink() = default;
  ProgressSink(const ProgressSink&) = delete;
  ProgressSink& operator=(const ProgressSink&) = delete;
  virtual ~ProgressSink() = default;

  /// A stage starts that takes `total` steps of about equal cost; 0: nobody knows how many.
  virtual void begin(std::string_view /*stage*/, std::uint64_t /*total*/) {}
  /// `steps` more of the current stage are done.
  virtual void advance(std::uint64_t /*steps*/) {}
  virtual void end() {}
  /// One line for the user that is not an error, such as a warning.
  virtual void message(std::string_view /*line*/) {}
  /// The solver has done so many iterations; the worst column's relative residual, as the devices see it. From the
  /// thread that solves.
  virtual void iteration(std::uint32_t /*number*/, double /*residual*/) {}
  /// Whether the user wants no further work but the best result so far. Asked after each iteration.
  [[nodiscard]] virtual bool interrupted() { return false; }
  /// A decision that hangs on time: where several processes do the same work, what the first of them says.
  [[nodiscard]] virtual bool decide(bool mine) { return mine; }
};

}  // namespace interflect
