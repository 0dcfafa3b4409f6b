#include "interflect/solver/batches.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

BatchedSolve::BatchedSolve(Method method, const StopTest& stop, std::span<const double> area,
                           const Columns& reflectance, const Columns& emittance, double interval)
    : method_(method),
      stop_(stop),
      area_(area),
      reflectance_(reflectance),
      emittance_(emittance),
      interval_(interval),
      radiosity_(emittance.size()) {
  if (emittance.empty() || reflectance.empty() || emittance.size() % reflectance.size() != 0) {
    throw Error(ErrorKind::usage, fmt::format("solve: {} columns of reflectances for {} of emittances",
                                              reflectance.size(), emittance.size()));
  }
}

void BatchedSolve::cut(const Scheduler& scheduler) {
  if (at_once_ != 0 && at_once_ != scheduler.most_columns()) {
    throw Error(ErrorKind::internal, "a solve goes on with another number of columns at once");
  }
  if (!batches_.empty()) return;
  if (!guess_.empty() && guess_.size() != emittance_.size()) {
    throw Error(ErrorKind::usage, fmt::format("solve: {} columns to begin at for {} of emittances", guess_.size(),
                                              emittance_.size()));
  }
  at_once_ = scheduler.most_columns();
  for (std::size_t first = 0; first < emittance_.size(); first += at_once_) {
    batches_.push_back({first, std::min<std::size_t>(at_once_, emittance_.size() - first)});
    Batch& batch = batches_.back();
    batch.checkpoint.interval = interval_;
    if (guess_.empty()) continue;
    const auto begin = std::make_move_iterator(guess_.begin() + static_cast<std::ptrdiff_t>(first));
    batch.checkpoint.b.assign(begin, begin + static_cast<std::ptrdiff_t>(batch.columns));
  }
  guess_.clear();
}

void BatchedSolve::run(Scheduler& scheduler, ProgressSink* progress) {
  cut(scheduler);
  for (Batch& batch : batches_) {
    if (batch.done) continue;
    Columns rho(batch.columns), e(batch.columns), b;
    for (std::size_t c = 0; c < batch.columns; ++c) {
      rho[c] = reflectance_[(batch.first + c) % reflectance_.size()];
      e[c] = emittance_[batch.first + c];
    }
    scheduler.use_columns(static_cast<std::uint32_t>(batch.columns));
    batch.done = solve(scheduler, method_, stop_, area_, rho, e, b, progress, &batch.checkpoint);
    for (std::size_t c = 0; c < batch.columns; ++c) radiosity_[batch.first + c] = std::move(b[c]);
  }
}

void BatchedSolve::begin_anew() {
  for (Batch& batch : batches_) batch.done.reset();
}

SolveReport BatchedSolve::report() const {
  SolveReport all;
  all.converged = true;
  for (const Batch& batch : batches_) {
    if (!batch.done) continue;
    const SolveReport& one = *batch.done;
    all.converged = all.converged && one.converged;
    all.iterations = std::max(all.iterations, one.iterations);
    all.passes = std::max(all.passes, one.passes);
    all.products += one.products;
    all.restarts += one.restarts;
    all.seconds += one.seconds;
    all.relative_residual.insert(all.relative_residual.end(), one.relative_residual.begin(),
                                 one.relative_residual.end());
    if (all.reason.empty()) all.reason = one.reason;
  }
  return all;
}

std::uint64_t BatchedSolve::kept_iterations() const {
  std::uint64_t kept = 0;
  for (const Batch& batch : batches_) kept += batch.checkpoint.kept_iterations + (batch.done ? 1 : 0);
  return kept;
}

}  // namespace interflect
