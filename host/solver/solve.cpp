#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/solver/correction.h"
#include "interflect/solver/problem.h"
#include "interflect/solver/solver.h"
#include "interflect/solver/stopping.h"

namespace interflect {

std::string_view name(Method method) {
  switch (method) {
    case Method::cg: return "cg";
    case Method::bicgstab: return "bicgstab";
    case Method::jacobi: return "jacobi";
  }
  return "?";
}

namespace {

constexpr std::uint32_t most_passes = 10;
// Looks without progress after which a pass ends. Krylov methods may pause; Jacobi falls evenly, if slowly.
constexpr std::uint32_t krylov_patience = 50;
constexpr std::uint32_t jacobi_patience = 1000;

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

 private:
  ProgressSink* sink_;
  std::uint64_t shown_ = 0;
};

/// One solve: b in fp32, its residual in double, and passes that correct b.
class Refinement {
 public:
  Refinement(Scheduler& scheduler, Method method, const StopTest& stop, const Problem& problem, Bar& bar)
      : scheduler_(scheduler), method_(method), stop_(stop), problem_(problem), bar_(bar) {}

  /// Fills report and b; `residual` is e on entry.
  void run(SolveReport& report, Columns& b, std::vector<std::vector<double>> residual);

 private:
  [[nodiscard]] std::uint32_t budget(const SolveReport& report) const {
    const std::uint32_t whole = stop_.iterations.value_or(stop_.max_iterations);
    return whole - std::min(whole, report.iterations);
  }
  [[nodiscard]] bool within_tolerance(const SolveReport& report) const {
    return std::all_of(report.relative_residual.begin(), report.relative_residual.end(),
                       [&](double relative) { return relative <= stop_.tolerance; });
  }
  Verdict pass(SolveReport& report, const Columns& b, const std::vector<std::vector<double>>& residual, Columns& next);
  Verdict iterate(SolveReport& report, std::span<const float> target);
  bool accept(SolveReport& report, Columns& b, std::vector<std::vector<double>>& residual, Columns& next);
  void say_why(SolveReport& report, Verdict verdict) const;

  Scheduler& scheduler_;
  Method method_;
  const StopTest& stop_;
  const Problem& problem_;
  Bar& bar_;
  std::unique_ptr<Correction> correction_;
};

void Refinement::run(SolveReport& report, Columns& b, std::vector<std::vector<double>> residual) {
  const bool dark = std::all_of(problem_.norms().begin(), problem_.norms().end(), [](double n) { return n == 0.0; });
  if (dark || (within_tolerance(report) && !stop_.iterations)) {
    report.converged = true;
    return;
  }
  correction_ = make_correction(method_, scheduler_, problem_.reflectance(), problem_.weight());
  Verdict verdict = Verdict::go_on;
  bool improved = true;
  Columns next;
  while (improved && report.passes < most_passes) {
    verdict = pass(report, b, residual, next);
    improved = accept(report, b, residual, next);
    report.converged = within_tolerance(report);
    if (report.converged || verdict == Verdict::not_finite || budget(report) == 0) break;
  }
  if (!report.converged) say_why(report, verdict);
}

/// One single-precision solve for the residual: next = b + r + x, with r/‖r‖ as right-hand side.
Verdict Refinement::pass(SolveReport& report, const Columns& b, const std::vector<std::vector<double>>& residual,
                         Columns& next) {
  const std::size_t columns = b.size();
  std::vector<double> scale(columns);
  std::vector<float> target(columns);
  Columns g(columns);
  for (std::size_t c = 0; c < columns; ++c) {
    const double relative = report.relative_residual[c];
    const bool open = relative > stop_.tolerance || (stop_.iterations && relative > 0);
    scale[c] = open ? relative * problem_.norms()[c] : 0.0;
    target[c] = stop_.iterations ? 1e-30F : open ? pass_target(stop_.tolerance, relative) : 0.0F;
    g[c].resize(b[c].size());
    const double inverse = open ? 1.0 / scale[c] : 0.0;
    for (std::size_t i = 0; i < g[c].size(); ++i) g[c][i] = static_cast<float>(residual[c][i] * inverse);
  }
  Verdict verdict = Verdict::go_on;
  Columns x;
  if (budget(report) > 0) {
    correction_->begin(g, target);
    report.iterations += correction_->iterations_of_begin();
    verdict = iterate(report, target);
    correction_->solution(x);
    report.restarts += correction_->restarts();
  }
  next = b;
  for (std::size_t c = 0; c < columns; ++c) {
    if (scale[c] == 0.0) continue;
    const auto corrected = [&](std::size_t i, double scale) {
      const double correction = scale == 0.0 ? 0.0 : scale * static_cast<double>(x[c][i]);
      return static_cast<float>(static_cast<double>(b[c][i]) + residual[c][i] + correction);
    };
    bool usable = !x.empty();
    for (std::size_t i = 0; usable && i < next[c].size(); ++i) {
      next[c][i] = corrected(i, scale[c]);
      usable = std::isfinite(next[c][i]);
    }
    if (usable) continue;
    for (std::size_t i = 0; i < next[c].size(); ++i) next[c][i] = corrected(i, 0.0);
  }
  ++report.passes;
  return verdict;
}

/// Iterates until the pass's target, the end of the budget, or trouble.
Verdict Refinement::iterate(SolveReport& report, std::span<const float> target) {
  Stopping stopping(target, method_ == Method::jacobi ? jacobi_patience : krylov_patience);
  const std::vector<double> start = report.relative_residual;
  while (true) {
    const std::span<const float> rr = correction_->residuals();
    const Verdict verdict = stopping.look(rr);
    double worst = 0;
    for (std::size_t c = 0; c < start.size(); ++c) {
      worst = std::max(worst, start[c] * std::sqrt(static_cast<double>(rr[c])));
    }
    bar_.show(stop_.iterations ? static_cast<double>(report.iterations) / *stop_.iterations
                               : progress_made(stop_.tolerance, worst));
    const bool exactly = stop_.iterations.has_value() && verdict != Verdict::not_finite;
    if ((verdict != Verdict::go_on && !exactly) || budget(report) == 0) return verdict;
    correction_->iterate();
    ++report.iterations;
  }
}

/// Takes every column of `next` whose residual is smaller than before (the first pass is always taken). True when an
/// open column's residual has at least halved: then another pass is worth its price.
bool Refinement::accept(SolveReport& report, Columns& b, std::vector<std::vector<double>>& residual, Columns& next) {
  std::vector<std::vector<double>> r;
  problem_.residual(next, r);
  bool improved = false;
  for (std::size_t c = 0; c < b.size(); ++c) {
    const double before = report.relative_residual[c];
    const double after = problem_.relative(r[c], c);
    if (report.passes > 1 && !(after < before)) continue;
    improved = improved || (before > stop_.tolerance && after < 0.5 * before);
    report.relative_residual[c] = after;
    std::swap(residual[c], r[c]);
    std::swap(b[c], next[c]);
  }
  return improved;
}

void Refinement::say_why(SolveReport& report, Verdict verdict) const {
  const double worst = *std::max_element(report.relative_residual.begin(), report.relative_residual.end());
  const std::string left = fmt::format("the relative residual is {:.2g}, {:.2g} was asked for", worst, stop_.tolerance);
  if (verdict == Verdict::not_finite) {
    report.reason = fmt::format("the residual is no longer finite after {} iterations; {}", report.iterations, left);
  } else if (budget(report) == 0) {
    report.reason = fmt::format("the limit of {} iterations is reached; {}", report.iterations, left);
  } else {
    report.reason =
        fmt::format("no further progress after {} iterations in single precision; {}", report.iterations, left);
  }
}

}  // namespace

SolveReport solve(Scheduler& scheduler, Method method, const StopTest& stop, std::span<const double> area,
                  const Columns& reflectance, const Columns& emittance, Columns& radiosity, ProgressSink* progress) {
  const Timer timer;
  if (!(stop.tolerance >= 0.0) || !std::isfinite(stop.tolerance)) {
    throw Error(ErrorKind::usage, fmt::format("the tolerance is {}, it must be 0 or more", stop.tolerance));
  }
  const Problem problem(scheduler, area, reflectance, emittance);
  const std::uint64_t products_before = scheduler.products();
  SolveReport report;
  std::vector<std::vector<double>> residual;
  for (std::size_t c = 0; c < emittance.size(); ++c) {
    residual.emplace_back(emittance[c].begin(), emittance[c].end());
    report.relative_residual.push_back(problem.norms()[c] > 0 ? 1.0 : 0.0);
  }
  Columns b(emittance.size(), std::vector<float>(scheduler.size()));
  {
    Bar bar(progress, "Solve");
    Refinement(scheduler, method, stop, problem, bar).run(report, b, std::move(residual));
  }
  radiosity = std::move(b);
  report.products = static_cast<std::uint32_t>(scheduler.products() - products_before);
  report.seconds = timer.seconds();
  return report;
}

}  // namespace interflect
