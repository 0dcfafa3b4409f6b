#include "interflect/solver/batches.h"

#include <fmt/format.h>

#include <algorithm>
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
      radiosity_(emittance.size()) {
  if (emittance.empty() || reflectance.empty() || emittance.size() % reflectance.size() != 0) {
    throw Error(ErrorKind::usage, fmt::format("solve: {} columns of reflectances for {} of emittances",
                                              reflectance.size(), emittance.size()));
  }
  batches_.push_back({0, emittance.size()});
  batches_.back().checkpoint.interval = interval;
}

void BatchedSolve::begin_at(Columns guess) {
  if (guess.size() != emittance_.size()) {
    throw Error(ErrorKind::usage,
                fmt::format("solve: {} columns to begin at for {} of emittances", guess.size(), emittance_.size()));
  }
  batches_.front().checkpoint.b = std::move(guess);
}

void BatchedSolve::keep_in(IterateKeeper& keeper) {
  keeper_ = &keeper;
  if (keeper.found() != nullptr) begin_at(*keeper.found());
  batches_.front().checkpoint.interval = std::min(batches_.front().checkpoint.interval, keeper.interval());
}

/// Columns that have come equally far become a batch.
void BatchedSolve::begin_at(const Iterate& iterate) {
  const std::size_t columns = emittance_.size();
  if (iterate.b.size() != columns || iterate.made.size() != columns) {
    throw Error(ErrorKind::usage,
                fmt::format("solve: {} columns to go on from for {} of emittances", iterate.b.size(), columns));
  }
  const double interval = batches_.front().checkpoint.interval;
  batches_.clear();
  for (std::size_t c = 0; c < columns; ++c) {
    const std::uint32_t made = iterate.made[c];
    if (c == 0 || made != iterate.made[c - 1]) {
      Batch batch{c, 0};
      batch.made = batch.checkpoint.kept_iterations = batch.checkpoint.iterations = made;
      batch.checkpoint.interval = interval;
      batches_.push_back(std::move(batch));
    }
    Batch& batch = batches_.back();
    ++batch.columns;
    if (made > 0) batch.checkpoint.b.push_back(iterate.b[c]);
  }
  Checkpoint& first = batches_.front().checkpoint;
  first.products = iterate.products;
  first.passes = iterate.passes;
  first.restarts = iterate.restarts;
  first.seconds = iterate.seconds;
}

/// Where every column stands, one batch being in the middle of its solve.
Iterate BatchedSolve::iterate(const Moment& now) const {
  Iterate all;
  for (const Batch& batch : batches_) {
    const bool running = &batch == now.batch;
    for (std::size_t c = 0; c < batch.columns; ++c) {
      const Columns& kept = batch.checkpoint.b;
      if (running) {
        all.b.push_back((*now.b)[c]);
      } else if (batch.done) {
        all.b.push_back(radiosity_[batch.first + c]);
      } else {
        all.b.push_back(kept.empty() ? std::vector<float>(area_.size()) : kept[c]);
      }
      all.made.push_back(running || batch.done || !kept.empty() ? batch.made : 0);
    }
    const Checkpoint& before = batch.checkpoint;
    const SolveReport* spent = running ? now.spent : batch.done ? &*batch.done : nullptr;
    all.products += spent != nullptr ? spent->products : before.products;
    all.restarts += spent != nullptr ? spent->restarts : before.restarts;
    all.seconds += spent != nullptr ? spent->seconds : before.seconds;
    all.passes = std::max(all.passes, spent != nullptr ? spent->passes : before.passes);
  }
  return all;
}

/// Batches of at most so many columns. What a batch has come to goes with its columns; what it has spent stays with the
/// first of its parts.
void BatchedSolve::cut(std::uint32_t most) {
  std::vector<Batch> cut;
  for (Batch& batch : batches_) {
    if (batch.done || batch.columns <= most) {
      cut.push_back(std::move(batch));
      continue;
    }
    const Checkpoint whole = std::move(batch.checkpoint);
    for (std::size_t at = 0; at < batch.columns; at += most) {
      Batch part{batch.first + at, std::min<std::size_t>(most, batch.columns - at)};
      if (at == 0) part.checkpoint = whole;
      part.checkpoint.interval = whole.interval;
      part.checkpoint.kept_iterations = part.made = whole.kept_iterations;
      part.checkpoint.b.clear();
      for (std::size_t c = 0; c < part.columns && !whole.b.empty(); ++c) part.checkpoint.b.push_back(whole.b[at + c]);
      cut.push_back(std::move(part));
    }
  }
  batches_ = std::move(cut);
}

void BatchedSolve::run(Scheduler& scheduler, ProgressSink* progress) {
  cut(scheduler.most_columns());
  const auto keep_all = [&] {
    if (keeper_ == nullptr) return;
    const Iterate all = iterate({});
    if (all.iterations() > 0) keeper_->keep(all);
  };
  for (Batch& batch : batches_) {
    if (batch.done) continue;
    try {
      run(batch, scheduler, progress);
    } catch (const Error&) {
      batch.checkpoint.keep = {};
      batch.made = batch.checkpoint.kept_iterations;
      keep_all();
      throw;
    }
  }
  keep_all();
}

void BatchedSolve::run(Batch& batch, Scheduler& scheduler, ProgressSink* progress) {
  Columns rho(batch.columns), e(batch.columns), b;
  for (std::size_t c = 0; c < batch.columns; ++c) {
    rho[c] = reflectance_[(batch.first + c) % reflectance_.size()];
    e[c] = emittance_[batch.first + c];
  }
  scheduler.use_columns(static_cast<std::uint32_t>(batch.columns));
  if (keeper_ != nullptr) {
    batch.checkpoint.keep = [&](const Columns& now, std::uint32_t made, const SolveReport& spent) {
      batch.made = made;
      if (made > 0 && keeper_->due()) keeper_->keep(iterate({&batch, &now, &spent}));
    };
  }
  batch.done = solve(scheduler, method_, stop_, area_, rho, e, b, progress, &batch.checkpoint);
  batch.checkpoint.keep = {};
  for (std::size_t c = 0; c < batch.columns; ++c) radiosity_[batch.first + c] = std::move(b[c]);
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
    all.interrupted = all.interrupted || one.interrupted;
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
  for (const Batch& batch : batches_) {
    kept += batch.columns * (std::uint64_t{batch.checkpoint.kept_iterations} + (batch.done ? 1 : 0));
  }
  return kept;
}

}  // namespace interflect
