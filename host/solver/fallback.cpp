#include "interflect/solver/fallback.h"

#include <fmt/format.h>

#include <utility>

#include "interflect/base/timer.h"
#include "interflect/solver/batches.h"

namespace interflect {

Candidates::Candidates(std::vector<std::string> ids, Open open, ProgressSink* progress)
    : ids_(std::move(ids)), open_(std::move(open)), progress_(progress) {
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
    try {
      device_ = open_(ids_[at_]);
    } catch (const Error& error) {
      give_up(error);
    }
  }
}

std::unique_ptr<Device> Candidates::take() {
  open();
  return std::move(device_);
}

void Candidates::give_up(const Error& error) {
  if (error.kind() != ErrorKind::device && error.kind() != ErrorKind::limit) throw error;
  failures_.push_back({ids_[at_], error.what()});
  if (at_ + 1 == ids_.size()) throw error;
  ++at_;
  if (progress_ == nullptr) return;
  const std::string_view reason = failures_.back().reason;
  progress_->message(fmt::format("warning: {}; going on with {}", reason.substr(0, reason.find('\n')), ids_[at_]));
}

const DeviceInfo& Candidates::info() {
  return device().info();
}

Device& Candidates::device() {
  open();
  return *device_;
}

FallbackReport solve_on(Candidates& candidates, const Place& place, Method method, const StopTest& stop,
                        std::span<const double> area, const Columns& reflectance, const Columns& emittance,
                        Columns& radiosity, ProgressSink* progress, double interval,
                        const std::function<void(Scheduler&)>& after) {
  FallbackReport result;
  BatchedSolve solve(method, stop, area, reflectance, emittance, interval);
  if (candidates.keeper() != nullptr) solve.keep_in(*candidates.keeper());
  std::unique_ptr<Scheduler> scheduler;
  for (bool done = false; !done;) {
    const std::uint64_t before = solve.kept_iterations();
    bool solved = false;
    candidates.open();
    const std::string id = candidates.id();
    try {
      const Timer timer;
      scheduler.reset();
      scheduler = place(candidates.take());
      result.upload_seconds += timer.seconds() - scheduler->compile_seconds();
      result.uploaded_bytes += scheduler->uploaded_bytes();
      solve.run(*scheduler, progress);
      solved = true;
      radiosity = solve.radiosity();
      if (after) after(*scheduler);
      done = true;
    } catch (const Error& error) {
      if (solved) solve.begin_anew();
      candidates.give_up(error);
    }
    if (done || solve.kept_iterations() > before) result.devices.push_back(id);
  }
  result.report = solve.report();
  result.failures = candidates.failures();
  return result;
}

FallbackReport solve_on(Candidates& candidates, const FormFactorMatrix& form_factors, Method method,
                        const StopTest& stop, std::span<const double> area, const Columns& reflectance,
                        const Columns& emittance, Columns& radiosity, ProgressSink* progress, double interval,
                        const std::function<void(Scheduler&)>& after) {
  const Place place = [&](std::unique_ptr<Device> device) {
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(std::move(device));
    return std::make_unique<Scheduler>(form_factors, std::move(devices), columns_at_once(emittance.size()));
  };
  return solve_on(candidates, place, method, stop, area, reflectance, emittance, radiosity, progress, interval, after);
}

}  // namespace interflect
