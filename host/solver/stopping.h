#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace interflect {

/// What a look at the residuals of one pass says.
enum class Verdict { go_on, reached, stalled, not_finite };

/// The stop test of one pass: watches the squared residuals (r, r) of all columns, one look per iteration.
/// reached: none is above its target. not_finite: one is infinite or no number. stalled: no column above its target has
/// come to 0.9 of its best residual within `patience` looks.
class Stopping {
 public:
  Stopping(std::span<const float> target, std::uint32_t patience);

  [[nodiscard]] Verdict look(std::span<const float> rr);

 private:
  std::vector<float> target_;
  std::vector<float> best_;
  std::uint32_t patience_;
  std::uint32_t without_progress_ = 0;
};

/// The target of (r, r) relative to a pass's right-hand side of norm 1, when the residual that the pass starts from is
/// `relative` of ‖e‖ and `tolerance` of ‖e‖ is wanted. A tenth is left for what rounding adds to the residual behind
/// the recurrence's back; and no pass is asked for more than fp32 can give it.
[[nodiscard]] float pass_target(double tolerance, double relative);

/// How much of the way from ‖e‖ to the tolerance a residual has come, 0 to 1, in orders of magnitude.
[[nodiscard]] double progress_made(double tolerance, double relative);

}  // namespace interflect
