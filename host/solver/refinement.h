#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "interflect/base/timer.h"
#include "interflect/solver/correction.h"
#include "interflect/solver/problem.h"
#include "interflect/solver/solver.h"
#include "interflect/solver/stopping.h"

namespace interflect {

/// Percent of the way to the tolerance, for the bar.
class Bar {
 public:
  Bar(ProgressSink* sink, std::string_view stage) : sink_(sink) {
    if (sink_ != nullptr) sink_->begin(stage, 100);
  }
  Bar(const Bar&) = delete;
  Bar& operator=(const Bar&) = delete;
  ~Bar() {
    if (sink_ != nullptr) sink_->end();
  }
  void show(double share) {
    const auto percent = static_cast<std::uint64_t>(100.0 * std::clamp(share, 0.0, 1.0));
    if (sink_ == nullptr || percent <= shown_) return;
    sink_->advance(percent - shown_);
    shown_ = percent;
  }
  /// Once for each: a pass begins with a look at where the one before it ended.
  void iteration(std::uint32_t number, double residual) {
    if (sink_ != nullptr && number > told_) sink_->iteration(number, residual);
    told_ = number;
  }
  [[nodiscard]] bool interrupted() const { return sink_ != nullptr && sink_->interrupted(); }
  [[nodiscard]] bool decide(bool mine) const { return sink_ != nullptr ? sink_->decide(mine) : mine; }

 private:
  ProgressSink* sink_;
  std::uint64_t shown_ = 0;
  std::uint32_t told_ = 0;
};

/// One solve: b in fp32, its residual in double, and passes that correct b.
class Refinement {
 public:
  Refinement(Scheduler& scheduler, Method method, const StopTest& stop, const Problem& problem, Bar& bar,
             SolveReport& report)
      : scheduler_(scheduler), method_(method), stop_(stop), problem_(problem), bar_(bar), report_(report) {}

  /// Begins at b = 0, or where the checkpoint ends. From then on the report is kept up to date.
  void begin(const Columns& emittance, const Checkpoint* checkpoint);
  void run();
  /// The last good iterate, for a device that goes on; called after a failure.
  void leave(Checkpoint& checkpoint);
  [[nodiscard]] Columns& b() { return b_; }

  /// Called with each good iterate, and the iterations that it is made of.
  std::function<void(const Columns&, std::uint32_t)> keep = [](const Columns&, std::uint32_t) {};

 private:
  [[nodiscard]] std::uint32_t budget() const {
    const std::uint32_t whole = stop_.iterations.value_or(stop_.max_iterations);
    return whole - std::min(whole, made_);
  }
  void count(std::uint32_t iterations) {
    made_ += iterations;
    report_.iterations += iterations;
  }
  [[nodiscard]] bool within_tolerance() const {
    return std::all_of(report_.relative_residual.begin(), report_.relative_residual.end(),
                       [&](double relative) { return relative <= stop_.tolerance; });
  }
  Verdict pass(Columns& next);
  Verdict iterate(std::span<const float> target);
  bool corrected(const Columns& x, Columns& next) const;
  void take_checkpoint();
  bool accept(Columns& next);
  void say_why(Verdict verdict) const;

  Scheduler& scheduler_;
  Method method_;
  const StopTest& stop_;
  const Problem& problem_;
  Bar& bar_;
  SolveReport& report_;
  std::unique_ptr<Correction> correction_;

  Columns b_;
  std::vector<std::vector<double>> residual_;  ///< of b
  std::vector<double> scale_;                  ///< the norm that the pass has taken out of it; 0 for a closed column
  std::uint32_t made_ = 0;                     ///< iterations that lead to where the solve stands
  std::uint32_t kept_ = 0;                     ///< those that lead to b
  std::uint32_t passes_ = 0;                   ///< on this device
  bool resumed_ = false;

  double interval_ = std::numeric_limits<double>::infinity();
  Timer since_checkpoint_;
  Columns taken_;  ///< the newest checkpoint within a pass, made of taken_made_ iterations; empty: none
  std::uint32_t taken_made_ = 0;
};

}  // namespace interflect
