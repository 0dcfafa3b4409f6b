#include "interflect/solver/stopping.h"

#include <algorithm>
#include <cmath>

namespace interflect {

Stopping::Stopping(std::span<const float> target, std::uint32_t patience)
    : target_(target.begin(), target.end()),
      best_(target.size(), std::numeric_limits<float>::infinity()),
      patience_(patience) {}

Verdict Stopping::look(std::span<const float> rr) {
  bool reached = true;
  bool progress = false;
  for (std::size_t c = 0; c < target_.size(); ++c) {
    if (!std::isfinite(rr[c])) return Verdict::not_finite;
    if (rr[c] <= target_[c]) continue;
    reached = false;
    if (rr[c] < 0.81F * best_[c]) {  // 0.9 of the norm
      best_[c] = rr[c];
      progress = true;
    }
  }
  if (reached) return Verdict::reached;
  without_progress_ = progress ? 0 : without_progress_ + 1;
  return without_progress_ < patience_ ? Verdict::go_on : Verdict::stalled;
}

float pass_target(double tolerance, double relative) {
  constexpr double attainable = 3e-7;
  const double target = std::max(0.9 * tolerance / relative, attainable);
  return static_cast<float>(target * target);
}

double progress_made(double tolerance, double relative) {
  if (relative <= tolerance) return 1.0;
  if (relative >= 1.0 || tolerance <= 0.0) return 0.0;
  return std::log(relative) / std::log(tolerance);
}

}  // namespace interflect
