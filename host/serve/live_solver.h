#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/serve/live_scene.h"
#include "interflect/solver/solver.h"

namespace interflect::serve {

/// Largest difference of a radiosity, relative to the largest of its light group, that a 16-bit format may cause here:
/// a quarter of a step of the screen's.
inline constexpr double largest_live_rounding = 1e-3;

/// F on a device, ready for solves.
struct PlacedFormFactors {
  std::shared_ptr<const void> matrix = {};  ///< what the Scheduler reads, where that was made for it
  std::unique_ptr<Scheduler> scheduler;
};

/// How a LiveSolver comes to devices and to F on them.
struct Placement {
  std::function<std::unique_ptr<Device>(const std::string& id)> open;
  /// In the format that suits the device, or in dense32 where that must be.
  std::function<PlacedFormFactors(std::unique_ptr<Device>, std::uint32_t columns, bool dense32)> place;
  /// The F that 16-bit formats were rounded from; null: their rounding is not looked at.
  const FormFactorMatrix* exact = nullptr;
};

/// A solution of a changed scene.
struct LiveSolution {
  std::uint64_t number = 0;  ///< counts the solves
  Columns radiosity;         ///< 3 g + channel
  SolveReport report;
  double tolerance = 0;
  bool warm = false;  ///< it began at the last solution
  std::string device, storage;
  std::optional<double> rounding_error;  ///< of the storage format, as rounding_error() has it when F was placed
  double seconds = 0;                    ///< all of it, the columns' making included
  std::string notice;                    ///< a device that failed on the way; empty: none
};

/// Solves one scene over and over: F stays where it is, reflectances and emittances change, and each solve begins at
/// the last solution. To be used by one thread.
class LiveSolver {
 public:
  /// Tries the devices in order until one takes F and solves the scene as it is. What is given must outlive this.
  /// Throws the last one's Error when none does.
  LiveSolver(const LiveScene& scene, std::vector<std::string> devices, Placement placement, Method method,
             std::uint32_t max_iterations, double tolerance, ProgressSink& progress);

  /// On the device in use; when that fails, on the next of those that were given first, and `notice` says so. Throws
  /// the last Error when none is left.
  [[nodiscard]] LiveSolution solve(const Change& change);
  /// The last solution.
  [[nodiscard]] const LiveSolution& last() const { return last_; }
  /// Forgets the last solution: the next solve begins at 0.
  void forget() { begun_ = false; }

  /// From now on on this device: F is placed there and the last change solved on it from 0, so that it has shown what
  /// it can. When that fails its Error is thrown, and everything is as before. In a 16-bit format whose rounding moves
  /// a radiosity by more than largest_live_rounding F is placed again, in dense32.
  void use_device(const std::string& id);
  [[nodiscard]] const std::string& device() const { return device_; }
  [[nodiscard]] const std::string& device_name() const { return device_name_; }

 private:
  void use_first();
  [[nodiscard]] PlacedFormFactors placed_on(const std::string& id, bool dense32, DeviceInfo& info) const;
  [[nodiscard]] LiveSolution solve_with(Scheduler& scheduler, const Change& change, bool warm);
  [[nodiscard]] Columns guess(const Columns& reflectance, const Columns& emittance) const;
  [[nodiscard]] std::optional<double> rounding_of(Scheduler& scheduler, const LiveSolution& solution) const;

  const LiveScene& scene_;
  std::vector<std::string> devices_;
  Placement placement_;
  Method method_;
  std::uint32_t max_iterations_;
  ProgressSink& progress_;
  std::string device_, device_name_;
  PlacedFormFactors placed_;
  std::optional<double> rounding_;  ///< of placed_
  Change change_;                   ///< that of last_
  Columns reflectance_, emittance_;
  LiveSolution last_;
  bool begun_ = false;
  std::uint64_t solves_ = 0;
};

}  // namespace interflect::serve
