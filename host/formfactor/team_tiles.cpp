#include "interflect/formfactor/team_tiles.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <numeric>
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
  std::vector<std::deque<std::size_t>> open;  ///< one for all, or one for each maker
  std::deque<std::size_t>& of(std::size_t maker) { return open.size() == 1 ? open.front() : open[maker]; }
  std::size_t done = 0, working = 0;
  std::exception_ptr failure;  ///< ends it
  std::mutex mutex;
  std::condition_variable changed;
};

TeamTiles::TeamTiles(std::vector<std::unique_ptr<TileMaker>> makers, std::size_t blocks, Lost lost,
                     std::vector<double> shares)
    : makers_(std::move(makers)), blocks_(blocks), lost_(std::move(lost)), shares_(std::move(shares)) {}

/// All runs to one list; or, by shares, to one for each maker: its part of the tiles, nearest to where the parts end.
void TeamTiles::deal(Runs& runs) const {
  runs.open.resize(shares_.empty() ? 1 : makers_.size());
  double all = 0, tiles = 0;
  for (const Runs::Run& run : runs.all) all += static_cast<double>(tiles_in_rows(run.first, run.end, blocks_));
  const double sum = std::accumulate(shares_.begin(), shares_.end(), 0.0);
  std::size_t maker = 0;
  double end = shares_.empty() ? all : all * shares_.front() / sum;
  for (std::size_t number = 0; number < runs.all.size(); ++number) {
    const auto own = static_cast<double>(tiles_in_rows(runs.all[number].first, runs.all[number].end, blocks_));
    while (maker + 1 < runs.open.size() && tiles + own / 2 > end) end += all * shares_[++maker] / sum;
    runs.open[maker].push_back(number);
    tiles += own;
  }
  for (std::size_t k = 0; k < makers_.size() && !shares_.empty(); ++k) {
    if (makers_[k] == nullptr) hand_on(k, runs);
  }
}

/// The runs of a maker that is left out to the next one.
void TeamTiles::hand_on(std::size_t maker, Runs& runs) const {
  if (runs.open.size() == 1) return;
  std::size_t next = maker;
  do next = (next + 1) % makers_.size();
  while (next != maker && makers_[next] == nullptr);
  if (next == maker) return;
  std::deque<std::size_t>& to = runs.open[next];
  to.insert(to.end(), runs.open[maker].begin(), runs.open[maker].end());
  runs.open[maker].clear();
}

TileFacts TeamTiles::make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink& progress) {
  Runs runs;
  const std::uint64_t each =
      std::max<std::uint64_t>(1, tiles_in_rows(first, end, blocks_) / (runs_of_a_maker * makers_.size()));
  for (std::size_t row = first; row < end;) {
    std::size_t next = row + 1;
    while (next < end && tiles_in_rows(row, next, blocks_) < each) ++next;
    runs.all.push_back({row, next});
    row = next;
  }
  deal(runs);
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
    runs.changed.wait(
        lock, [&] { return !runs.of(maker).empty() || runs.done == runs.all.size() || runs.failure != nullptr; });
    if (runs.failure != nullptr || runs.of(maker).empty()) return;
    const std::size_t number = runs.of(maker).front();
    runs.of(maker).pop_front();
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
      runs.of(maker).push_front(number);
      --runs.working;
      if (error.kind() == ErrorKind::device) {
        makers_[maker].reset();
        hand_on(maker, runs);
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
