#include "interflect/serve/live_solver.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/solver/batches.h"
#include "interflect/solver/fallback.h"
#include "interflect/solver/rounding.h"

namespace interflect::serve {

namespace {

/// What another device can help with.
bool of_the_device(const Error& error) {
  return error.kind() == ErrorKind::device || error.kind() == ErrorKind::limit;
}

std::string first_line(std::string_view text) {
  return std::string(text.substr(0, text.find('\n')));
}

/// The factor that brings `from` nearest to `to`: 1 where they are equal, or where there is nothing to scale.
double scale_between(const std::vector<float>& from, const std::vector<float>& to) {
  double mixed = 0, square = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    mixed += static_cast<double>(from[i]) * static_cast<double>(to[i]);
    square += static_cast<double>(from[i]) * static_cast<double>(from[i]);
  }
  return square > 0 ? mixed / square : 1;
}

}  // namespace

LiveSolver::LiveSolver(const LiveScene& scene, std::vector<std::string> devices, Placement placement, Method method,
                       std::uint32_t max_iterations, double tolerance, ProgressSink& progress)
    : scene_(scene),
      devices_(std::move(devices)),
      placement_(std::move(placement)),
      method_(method),
      max_iterations_(max_iterations),
      progress_(progress) {
  if (devices_.empty()) throw Error(ErrorKind::usage, "no device is given");
  change_.tolerance = tolerance;
  use_first();
}

/// The first of devices_ that works; those before it are struck off.
void LiveSolver::use_first() {
  while (true) {
    try {
      use_device(devices_.front());
      return;
    } catch (const Error& error) {
      if (!of_the_device(error) || devices_.size() == 1) throw;
      devices_.erase(devices_.begin());
      progress_.message(fmt::format("warning: {}; going on with {}", first_line(error.what()), devices_.front()));
    }
  }
}

PlacedFormFactors LiveSolver::placed_on(const std::string& id, bool dense32, DeviceInfo& info) const {
  std::unique_ptr<Device> device = placement_.open(id);
  info = device->info();
  const auto columns = static_cast<std::uint32_t>(3 * scene_.lamps());
  return placement_.place(std::move(device), columns_at_once(columns), dense32);
}

void LiveSolver::use_device(const std::string& id) {
  DeviceInfo info;
  PlacedFormFactors placed = placed_on(id, false, info);
  Change probe = change_;
  // What b is off by would count as rounding: as far as solve goes by default.
  if (placed.scheduler->storage() != Storage::dense32) probe.tolerance = std::min(probe.tolerance, 1e-6);
  LiveSolution solution = solve_with(*placed.scheduler, probe, false);
  std::optional<double> rounding = rounding_of(*placed.scheduler, solution);
  if (rounding && !(*rounding <= largest_live_rounding)) {  // also NaN
    progress_.message(
        fmt::format("warning: {} is refused on {}: its rounding moves a radiosity by {:.1e} of the "
                    "largest, {:.0e} is allowed; dense32 is used",
                    interflect::name(placed.scheduler->storage()), id, *rounding, largest_live_rounding));
    rounding.reset();
    placed = placed_on(id, true, info);
    solution = solve_with(*placed.scheduler, change_, false);
  }
  std::swap(placed_, placed);  // the old one goes when all has gone well
  device_ = info.id;           // `id` may be "auto"
  device_name_ = info.name;
  rounding_ = solution.rounding_error = rounding;
  last_ = std::move(solution);
}

std::optional<double> LiveSolver::rounding_of(Scheduler& scheduler, const LiveSolution& solution) const {
  if (scheduler.storage() == Storage::dense32 || placement_.exact == nullptr) return std::nullopt;
  if (!solution.report.converged) return std::numeric_limits<double>::quiet_NaN();
  return rounding_error(scheduler, method_, *placement_.exact, scene_.mesh().area, scene_.reflectance(change_),
                        scene_.emittance(change_), solution.radiosity);
}

LiveSolution LiveSolver::solve(const Change& change) {
  std::string notice;
  while (true) {
    try {
      LiveSolution solution = solve_with(*placed_.scheduler, change, begun_);
      solution.notice = notice;
      solution.rounding_error = rounding_;
      last_ = solution;
      change_ = change;
      return solution;
    } catch (const Error& error) {
      if (!of_the_device(error)) throw;
      // A device that was chosen by hand need not be one of those that were given first.
      std::erase(devices_, device_);
      if (devices_.empty()) throw;
      notice = fmt::format("{}; going on with {}", first_line(error.what()), devices_.front());
      progress_.message("warning: " + notice);
      use_first();
    }
  }
}

/// b' = e' + ρ'∘(F b), where F b = (b − e) / ρ of the last solution b: the bounce that its walls' change makes, for
/// nothing. A lamp that was dimmed dims its columns.
Columns LiveSolver::guess(const Columns& reflectance, const Columns& emittance) const {
  Columns b = last_.radiosity;
  for (std::size_t k = 0; k < b.size(); ++k) {
    const std::vector<float>&rho = reflectance[k % 3], &old_rho = reflectance_[k % 3], &e = emittance[k],
          &old_e = emittance_[k];
    const double scale = scale_between(old_e, e);
    for (std::size_t i = 0; i < b[k].size(); ++i) {
      const double arrives = static_cast<double>(b[k][i]) - static_cast<double>(old_e[i]);
      const double share = rho[i] == old_rho[i] ? 1
                           : old_rho[i] > 0     ? static_cast<double>(rho[i]) / static_cast<double>(old_rho[i])
                                                : 0;
      const double value = static_cast<double>(e[i]) + scale * share * arrives;
      b[k][i] = std::isfinite(value) ? static_cast<float>(value) : e[i];
    }
  }
  return b;
}

LiveSolution LiveSolver::solve_with(Scheduler& scheduler, const Change& change, bool warm) {
  const Timer timer;
  LiveSolution solution;
  Columns reflectance = scene_.reflectance(change), emittance = scene_.emittance(change);
  StopTest stop;
  stop.tolerance = solution.tolerance = change.tolerance;
  stop.max_iterations = max_iterations_;
  const double compiled = scheduler.compile_seconds();
  BatchedSolve batches(method_, stop, scene_.mesh().area, reflectance, emittance);
  solution.warm = warm;
  if (warm) batches.begin_at(guess(reflectance, emittance));
  batches.run(scheduler, nullptr);
  solution.report = batches.report();
  solution.radiosity = std::move(batches.radiosity());
  solution.number = ++solves_;
  solution.device = scheduler.device_ids().front();
  solution.storage = interflect::name(scheduler.storage());
  solution.seconds = timer.seconds() - (scheduler.compile_seconds() - compiled);
  begun_ = true;
  last_.radiosity = solution.radiosity;
  reflectance_ = std::move(reflectance);
  emittance_ = std::move(emittance);
  return solution;
}

}  // namespace interflect::serve
