#include "interflect/solver/refinement.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

namespace interflect {

namespace {

constexpr std::uint32_t most_passes = 10;
// Looks without progress after which a pass ends. Krylov methods may pause; Jacobi falls evenly, if slowly.
constexpr std::uint32_t krylov_patience = 50;
constexpr std::uint32_t jacobi_patience = 1000;

}  // namespace

void Refinement::begin(const Columns& emittance, const Checkpoint* checkpoint) {
  const auto at_zero = [&](std::size_t c) {
    b_[c].assign(scheduler_.size(), 0.0F);
    residual_[c].assign(emittance[c].begin(), emittance[c].end());
    report_.relative_residual[c] = problem_.norms()[c] > 0 ? 1.0 : 0.0;
  };
  b_.resize(emittance.size());
  residual_.resize(emittance.size());
  report_.relative_residual.resize(emittance.size());
  if (checkpoint != nullptr) {
    interval_ = checkpoint->interval;
    report_.iterations = checkpoint->iterations;
    report_.passes = checkpoint->passes;
    report_.restarts = checkpoint->restarts;
  }
  resumed_ = checkpoint != nullptr && !checkpoint->b.empty();
  if (resumed_) {
    b_ = checkpoint->b;
    made_ = kept_ = checkpoint->kept_iterations;
    problem_.residual(b_, residual_);
  }
  bool any_good = false;
  for (std::size_t c = 0; c < b_.size(); ++c) {
    const double relative = resumed_ ? problem_.relative(residual_[c], c) : 0.0;
    const bool good = std::isfinite(relative) && (relative <= 1.0 || stop_.iterations);
    if (!resumed_ || !good) {
      at_zero(c);
    } else {
      report_.relative_residual[c] = relative;
      any_good = true;
    }
  }
  if (resumed_ && !any_good) {  // nothing of it was used: this is a beginning
    resumed_ = false;
    made_ = kept_ = 0;
  }
}

void Refinement::leave(Checkpoint& checkpoint) {
  if (!taken_.empty()) {
    checkpoint.b = std::move(taken_);
    checkpoint.kept_iterations = taken_made_;
  } else if (resumed_ || passes_ > 0) {
    checkpoint.b = std::move(b_);
    checkpoint.kept_iterations = kept_;
  }
  checkpoint.iterations = report_.iterations;
  checkpoint.passes = report_.passes;
  checkpoint.restarts = report_.restarts;
}

void Refinement::run() {
  const bool dark = std::all_of(problem_.norms().begin(), problem_.norms().end(), [](double n) { return n == 0.0; });
  report_.converged = dark || within_tolerance();
  if (dark || (report_.converged && !stop_.iterations)) return;
  Verdict verdict = Verdict::go_on;
  if (resumed_ && budget() == 0) {
    if (!report_.converged || report_.interrupted) say_why(verdict);
    return;
  }
  correction_ = make_correction(method_, scheduler_, problem_.reflectance(), problem_.weight());
  bool improved = true;
  Columns next;
  while (improved && passes_ < most_passes) {
    verdict = pass(next);
    improved = accept(next);
    report_.converged = within_tolerance();
    if (report_.converged || report_.interrupted || verdict == Verdict::not_finite || budget() == 0) break;
  }
  if (!report_.converged || report_.interrupted) say_why(verdict);
}

/// One single-precision solve for the residual: next = b + r + x, with r/‖r‖ as right-hand side.
Verdict Refinement::pass(Columns& next) {
  const std::size_t columns = b_.size();
  scale_.assign(columns, 0.0);
  std::vector<float> target(columns);
  Columns g(columns);
  for (std::size_t c = 0; c < columns; ++c) {
    const double relative = report_.relative_residual[c];
    const bool open = relative > stop_.tolerance || (stop_.iterations && relative > 0);
    scale_[c] = open ? relative * problem_.norms()[c] : 0.0;
    target[c] = stop_.iterations ? 1e-30F : open ? pass_target(stop_.tolerance, relative) : 0.0F;
    g[c].resize(b_[c].size());
    const double inverse = open ? 1.0 / scale_[c] : 0.0;
    for (std::size_t i = 0; i < g[c].size(); ++i) g[c][i] = static_cast<float>(residual_[c][i] * inverse);
  }
  // Where Jacobi goes on from another device's b, b + r is a bounce of its own.
  if (resumed_ && passes_ == 0 && method_ == Method::jacobi) count(1);
  Verdict verdict = Verdict::go_on;
  Columns x;
  if (budget() > 0) {
    correction_->begin(g, target);
    count(correction_->iterations_of_begin());
    verdict = iterate(target);
    correction_->solution(x);
    report_.restarts += correction_->restarts();
  }
  static_cast<void>(corrected(x, next));
  ++passes_;
  ++report_.passes;
  return verdict;
}

/// next = b + r + x; without x in a column where that is not finite, or where there is none. True when x could be used
/// in every open column.
bool Refinement::corrected(const Columns& x, Columns& next) const {
  next = b_;
  bool all_usable = true;
  for (std::size_t c = 0; c < b_.size(); ++c) {
    if (scale_[c] == 0.0) continue;
    const auto value = [&](std::size_t i, double scale) {
      const double correction = scale == 0.0 ? 0.0 : scale * static_cast<double>(x[c][i]);
      return static_cast<float>(static_cast<double>(b_[c][i]) + residual_[c][i] + correction);
    };
    bool usable = !x.empty();
    for (std::size_t i = 0; usable && i < next[c].size(); ++i) {
      next[c][i] = value(i, scale_[c]);
      usable = std::isfinite(next[c][i]);
    }
    if (usable) continue;
    all_usable = false;
    for (std::size_t i = 0; i < next[c].size(); ++i) next[c][i] = value(i, 0.0);
  }
  return all_usable;
}

void Refinement::take_checkpoint() {
  Columns x, next;
  correction_->solution(x);
  since_checkpoint_.restart();
  if (!corrected(x, next)) return;
  taken_ = std::move(next);
  taken_made_ = made_;
  keep(taken_, taken_made_);
}

/// Iterates until the pass's target, the end of the budget, or trouble.
Verdict Refinement::iterate(std::span<const float> target) {
  Stopping stopping(target, method_ == Method::jacobi ? jacobi_patience : krylov_patience);
  const std::vector<double> start = report_.relative_residual;
  while (true) {
    const std::span<const float> rr = correction_->residuals();
    const Verdict verdict = stopping.look(rr);
    double worst = 0;
    for (std::size_t c = 0; c < start.size(); ++c) {
      worst = std::max(worst, start[c] * std::sqrt(static_cast<double>(rr[c])));
    }
    bar_.show(stop_.iterations ? static_cast<double>(made_) / *stop_.iterations
                               : progress_made(stop_.tolerance, worst));
    if (made_ > 0) bar_.iteration(made_, worst);
    const bool exactly = stop_.iterations.has_value() && verdict != Verdict::not_finite;
    if ((verdict != Verdict::go_on && !exactly) || budget() == 0) return verdict;
    report_.interrupted = made_ > 0 && bar_.interrupted();
    if (report_.interrupted) return verdict;
    const bool takes_some = made_ > kept_ && std::isfinite(interval_);
    if (takes_some && bar_.decide(since_checkpoint_.seconds() >= interval_)) take_checkpoint();
    correction_->iterate();
    count(1);
  }
}

/// Takes every column of `next` whose residual is smaller than before (from b = 0, or after a fixed number of
/// iterations, it is always taken). True when an open column's residual has at least halved: then another pass is worth
/// its price.
bool Refinement::accept(Columns& next) {
  std::vector<std::vector<double>> r;
  problem_.residual(next, r);
  bool improved = false;
  for (std::size_t c = 0; c < b_.size(); ++c) {
    const double before = report_.relative_residual[c];
    const double after = problem_.relative(r[c], c);
    if ((resumed_ || passes_ > 1) && !stop_.iterations && !(after < before)) continue;
    improved = improved || (before > stop_.tolerance && after < 0.5 * before);
    report_.relative_residual[c] = after;
    std::swap(residual_[c], r[c]);
    std::swap(b_[c], next[c]);
  }
  kept_ = made_;
  taken_.clear();
  keep(b_, kept_);
  return improved;
}

void Refinement::say_why(Verdict verdict) const {
  const double worst = *std::max_element(report_.relative_residual.begin(), report_.relative_residual.end());
  const std::string left = fmt::format("the relative residual is {:.2g}, {:.2g} was asked for", worst, stop_.tolerance);
  if (report_.interrupted) {
    report_.reason = fmt::format("interrupted after {} iterations; {}", report_.iterations, left);
  } else if (verdict == Verdict::not_finite) {
    report_.reason = fmt::format("the residual is no longer finite after {} iterations; {}", report_.iterations, left);
  } else if (budget() == 0) {
    report_.reason = fmt::format("the limit of {} iterations is reached; {}", made_, left);
  } else {
    report_.reason =
        fmt::format("no further progress after {} iterations in single precision; {}", report_.iterations, left);
  }
}

}  // namespace interflect
