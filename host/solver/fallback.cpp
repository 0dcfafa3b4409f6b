#include "interflect/solver/fallback.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "interflect/base/timer.h"
#include "interflect/solver/batches.h"

namespace interflect {

Candidates::Candidates(std::vector<std::string> ids, Open open, ProgressSink* progress,
                       std::optional<SplitOptions> together)
    : ids_(std::move(ids)), open_(std::move(open)), progress_(progress), together_(std::move(together)) {
  if (ids_.empty()) throw Error(ErrorKind::usage, "no device is given");
}

Candidates::Candidates(std::unique_ptr<Device> device)
    : ids_{device->info().id},
      open_([](const std::string& id) -> std::unique_ptr<Device> {
        throw device_error(id, "open", "the device was given away before");
      }),
      device_(std::move(device)) {}

void Candidates::open() {
  while (device_ == nullptr) {
    const auto open = others_.find(ids_[at_]);
    if (open != others_.end()) {
      device_ = std::move(open->second);
      others_.erase(open);
      break;
    }
    try {
      device_ = open_(ids_[at_]);
    } catch (const Error& error) {
      give_up(error);
    }
  }
  for (std::size_t k = at_ + 1; together_ && k < ids_.size();) {
    const std::string id = ids_[k];
    try {
      if (!others_.contains(id)) others_.emplace(id, open_(id));
      ++k;
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::device && error.kind() != ErrorKind::limit) throw;
      lose({id, error.what()});
    }
  }
}

std::vector<std::unique_ptr<Device>> Candidates::take_all() {
  open();
  std::vector<std::unique_ptr<Device>> all;
  all.push_back(std::move(device_));
  for (std::size_t k = at_ + 1; together_ && k < ids_.size(); ++k) all.push_back(std::move(others_.at(ids_[k])));
  others_.clear();
  return all;
}

std::vector<Device*> Candidates::devices() {
  std::vector<Device*> all{&device()};
  for (std::size_t k = at_ + 1; together_ && k < ids_.size(); ++k) all.push_back(others_.at(ids_[k]).get());
  return all;
}

SplitOptions Candidates::split() const {
  SplitOptions split = together_.value_or(SplitOptions{});
  if (split.weights.empty()) return split;
  split.weights.erase(split.weights.begin(), split.weights.begin() + static_cast<std::ptrdiff_t>(at_));
  // Where only those are left that were to have nothing, they share.
  const bool none = std::none_of(split.weights.begin(), split.weights.end(), [](double weight) { return weight > 0; });
  if (none) split.weights.clear();
  return split;
}

void Candidates::lose(const DeviceFailure& failure) {
  const auto found = std::find(ids_.begin() + static_cast<std::ptrdiff_t>(at_) + 1, ids_.end(), failure.device);
  if (found != ids_.end()) {
    if (together_ && !together_->weights.empty())
      together_->weights.erase(together_->weights.begin() + (found - ids_.begin()));
    ids_.erase(found);
  }
  others_.erase(failure.device);
  note(failure, "the others");
}

void Candidates::note(DeviceFailure failure, std::string_view next) {
  failures_.push_back(std::move(failure));
  if (progress_ == nullptr) return;
  const std::string_view reason = failures_.back().reason;
  progress_->message(fmt::format("warning: {}; going on with {}", reason.substr(0, reason.find('\n')), next));
}

std::unique_ptr<Device> Candidates::take() {
  open();
  return std::move(device_);
}

void Candidates::give_up(const Error& error) {
  if (error.kind() != ErrorKind::device && error.kind() != ErrorKind::limit) throw error;
  if (at_ + 1 == ids_.size()) {
    failures_.push_back({ids_[at_], error.what()});
    throw error;
  }
  ++at_;
  note({ids_[at_ - 1], error.what()}, at_once() > 1 ? "the others" : ids_[at_]);
}

const DeviceInfo& Candidates::info() {
  return device().info();
}

Device& Candidates::device() {
  open();
  return *device_;
}

namespace {

/// What the devices of one Scheduler have to say besides the solve's own report.
class Team {
 public:
  Team(Candidates& candidates, FallbackReport& result) : candidates_(candidates), result_(result) {}

  /// The ids in its order; those that have been lost count as long as their work may be in the result.
  void begin(const Scheduler& scheduler) {
    if (candidates_.at_once() > 1) ids_ = scheduler.device_ids();
    told_ = 0;
    hear(scheduler);
  }
  /// Hands the failures on that have not been.
  void hear(const Scheduler& scheduler) {
    const std::vector<DeviceFailure> failures = scheduler.failures();
    for (; told_ < failures.size(); ++told_) candidates_.lose(failures[told_]);
    result_.shares = scheduler.shares();
  }
  /// Their work is in the result.
  void worked() {
    for (const std::string& id : ids_) {
      const auto& all = result_.devices;
      if (std::find(all.begin(), all.end(), id) == all.end()) result_.devices.push_back(id);
    }
  }
  void say(std::vector<std::string> ids) { ids_ = std::move(ids); }

 private:
  Candidates& candidates_;
  FallbackReport& result_;
  std::vector<std::string> ids_;
  std::size_t told_ = 0;
};

}  // namespace

FallbackReport solve_on(Candidates& candidates, const Place& place, Method method, const StopTest& stop,
                        std::span<const double> area, const Columns& reflectance, const Columns& emittance,
                        Columns& radiosity, ProgressSink* progress, double interval,
                        const std::function<void(Scheduler&)>& after, LastFails last) {
  FallbackReport result;
  BatchedSolve solve(method, stop, area, reflectance, emittance, interval);
  if (candidates.keeper() != nullptr) solve.keep_in(*candidates.keeper());
  std::unique_ptr<Scheduler> scheduler;
  Team team(candidates, result);
  for (bool done = false; !done;) {
    const std::uint64_t before = solve.kept_iterations();
    bool solved = false;
    candidates.open();
    team.say({candidates.id()});
    try {
      const Timer timer;
      scheduler.reset();
      scheduler = place(candidates.take_all());
      team.begin(*scheduler);
      result.upload_seconds += timer.seconds() - scheduler->compile_seconds();
      result.uploaded_bytes += scheduler->uploaded_bytes();
      solve.run(*scheduler, progress);
      solved = true;
      radiosity = solve.radiosity();
      if (after) after(*scheduler);
      done = true;
      team.hear(*scheduler);
    } catch (const Error& error) {
      if (scheduler != nullptr) team.hear(*scheduler);
      try {
        candidates.give_up(error);
        if (solved) solve.begin_anew();
      } catch (const Error& none_left) {
        // The others may have died, or this one may have no room for all of F.
        const bool lost = none_left.kind() == ErrorKind::device || none_left.kind() == ErrorKind::limit;
        if (last == LastFails::throws || !lost || solve.kept_iterations() == 0) throw;
        result.lost = none_left;
        if (!solved) radiosity = solve.unfinished();
        done = true;
      }
    }
    if (done || solve.kept_iterations() > before) team.worked();
  }
  result.report = solve.report();
  if (result.lost && !result.report.converged) {
    result.report.reason = fmt::format("the last device was lost after {} iterations: {}", result.report.iterations,
                                       std::string(result.lost->what()));
  }
  result.failures = candidates.failures();
  return result;
}

FallbackReport solve_on(Candidates& candidates, const FormFactorMatrix& form_factors, Method method,
                        const StopTest& stop, std::span<const double> area, const Columns& reflectance,
                        const Columns& emittance, Columns& radiosity, ProgressSink* progress, double interval,
                        const std::function<void(Scheduler&)>& after, LastFails last) {
  const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
    return std::make_unique<Scheduler>(form_factors, std::move(devices), columns_at_once(emittance.size()),
                                       candidates.split());
  };
  return solve_on(candidates, place, method, stop, area, reflectance, emittance, radiosity, progress, interval, after,
                  last);
}

}  // namespace interflect
