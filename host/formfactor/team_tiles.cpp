#include "interflect/formfactor/team_tiles.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace interflect {

namespace {

constexpr std::uint64_t runs_of_a_maker = 12;  // so that all end at about the same time

}  // namespace

/// What is to be made, and what has been.
struct TeamTiles::Runs {
  struct Run {
    std::size_t first = 0, end = 0;
    TileFacts facts = {};
  };
  std::vector<Run> all;
  std::deque<std::size_t> open;
  std::size_t done = 0, working = 0;
  std::exception_ptr failure;  ///< ends it
  std::mutex mutex;
  std::condition_variable changed;
};

TeamTiles::TeamTiles(std::vector<std::unique_ptr<TileMaker>> makers, std::size_t blocks, Lost lost)
    : makers_(std::move(makers)), blocks_(blocks), lost_(std::move(lost)) {}

TileFacts TeamTiles::make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink& progress) {
  Runs runs;
  const std::uint64_t each =
      std::max<std::uint64_t>(1, tiles_in_rows(first, end, blocks_) / (runs_of_a_maker * makers_.size()));
  for (std::size_t row = first; row < end;) {
    std::size_t next = row + 1;
    while (next < end && tiles_in_rows(row, next, blocks_) < each) ++next;
    runs.open.push_back(runs.all.size());
    runs.all.push_back({row, next});
    row = next;
  }
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < makers_.size(); ++k) {
    if (makers_[k] == nullptr) continue;
    ++runs.working;
    threads.emplace_back([&, k] { work(k, runs, sink, progress); });
  }
  for (std::thread& thread : threads) thread.join();
  if (runs.failure != nullptr) std::rethrow_exception(runs.failure);
  if (runs.done != runs.all.size()) throw Error(ErrorKind::internal, "tiles are missing: no maker is left");
  TileFacts facts;
  for (const Runs::Run& run : runs.all) {
    facts.pairs_considered += run.facts.pairs_considered;
    facts.pairs_analytic += run.facts.pairs_analytic;
    facts.rays += run.facts.rays;
    facts.trace_seconds += run.facts.trace_seconds;
    facts.variance.insert(facts.variance.end(), run.facts.variance.begin(), run.facts.variance.end());
  }
  return facts;
}

void TeamTiles::work(std::size_t maker, Runs& runs, const TileSink& sink, ProgressSink& progress) {
  std::unique_lock lock(runs.mutex);
  while (true) {
    // Where none is open, one may come back from a maker that fails.
    runs.changed.wait(lock,
                      [&] { return !runs.open.empty() || runs.done == runs.all.size() || runs.failure != nullptr; });
    if (runs.failure != nullptr || runs.open.empty()) return;
    const std::size_t number = runs.open.front();
    runs.open.pop_front();
    const Runs::Run run = runs.all[number];
    lock.unlock();
    try {
      ProgressSink silent;
      TileFacts facts = makers_[maker]->make(run.first, run.end, sink, silent);
      progress.advance(tiles_in_rows(run.first, run.end, blocks_));
      lock.lock();
      runs.all[number].facts = std::move(facts);
      ++runs.done;
    } catch (const Error& error) {
      lock.lock();
      runs.open.push_front(number);
      --runs.working;
      if (error.kind() == ErrorKind::device) {
        makers_[maker].reset();
        lost_(maker, error);
      }
      if (error.kind() != ErrorKind::device || runs.working == 0) runs.failure = std::current_exception();
      runs.changed.notify_all();
      return;
    } catch (...) {
      lock.lock();
      runs.failure = std::current_exception();
    }
    runs.changed.notify_all();
  }
}

}  // namespace interflect
