#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/device/device.h"
#include "interflect/solver/iterate.h"
#include "interflect/solver/solver.h"

namespace interflect {

/// A device that a solve gave up, and why.
struct DeviceFailure {
  std::string device;  ///< id
  std::string reason;  ///< the Error's text; a compiler's log makes it several lines
};

/// The devices that a solve may use, in the order in which they are tried. One is open at a time.
class Candidates {
 public:
  using Open = std::function<std::unique_ptr<Device>(const std::string& id)>;

  /// `open` opens a device by id or throws an Error. Failures go to `progress` as warnings when it is given.
  Candidates(std::vector<std::string> ids, Open open, ProgressSink* progress = nullptr);
  /// One device that is open already.
  explicit Candidates(std::unique_ptr<Device> device);

  /// Opens the first that can be opened, if none is open: so that a device that is not there is found before other work
  /// begins. Throws the last one's Error when none can be opened.
  void open();
  /// The open device, opened if need be, for the caller to own.
  [[nodiscard]] std::unique_ptr<Device> take();
  /// Notes that the device taken last has failed and turns to the next. Throws `error` again when no other is left, or
  /// when it is of a kind that no other device can help with: only a device's own and its limits are.
  void give_up(const Error& error);

  /// What is known of the device that is open, opened if need be.
  [[nodiscard]] const DeviceInfo& info();
  /// That device, to be used before it is taken.
  [[nodiscard]] Device& device();

  /// Where solves on them keep their iterate: for a later run of the program, which is one candidate more. Null:
  /// nowhere.
  void keep_in(IterateKeeper* keeper) { keeper_ = keeper; }
  [[nodiscard]] IterateKeeper* keeper() const { return keeper_; }

  [[nodiscard]] const std::string& id() const {
    return ids_.at(at_);
  }  ///< of the device that is open or was taken last
  [[nodiscard]] const std::vector<DeviceFailure>& failures() const { return failures_; }

 private:
  std::vector<std::string> ids_;
  Open open_;
  ProgressSink* progress_ = nullptr;
  std::size_t at_ = 0;
  std::unique_ptr<Device> device_;
  std::vector<DeviceFailure> failures_;
  IterateKeeper* keeper_ = nullptr;
};

/// What solve_on() did.
struct FallbackReport {
  SolveReport report;                ///< of all devices together
  std::vector<std::string> devices;  ///< ids of those whose work is in the result, in order
  std::vector<DeviceFailure> failures;
  double upload_seconds = 0;         ///< placing F, on every device that was tried
  std::uint64_t uploaded_bytes = 0;  ///< of F, likewise
};

/// Makes a Scheduler of a device: places F, in whatever format, and throws what the Scheduler's constructor throws.
using Place = std::function<std::unique_ptr<Scheduler>(std::unique_ptr<Device>)>;

/// The columns for which a Scheduler is made that shall solve for so many.
[[nodiscard]] inline std::uint32_t columns_at_once(std::size_t columns) {
  return static_cast<std::uint32_t>(std::min<std::size_t>(columns, most_columns));
}

/// solve() on the first candidate; when that device fails (lost, out of memory, a kernel that does not compile) or one
/// of its limits is in the way, on the next one, from the last good iterate: the b of the last finished pass or a
/// checkpoint, taken every `interval` seconds of iterating. Throws what solve() throws, and the last candidate's Error
/// when none is left; radiosity is untouched then. `after`, when given, is called with the Scheduler on which the solve
/// ended well, whose columns are those of its last batch; when the device fails in it, the next one solves and calls it
/// again. More columns than the Scheduler was made with are solved in batches, and reflectances may be fewer than
/// emittances: see BatchedSolve.
[[nodiscard]] FallbackReport solve_on(Candidates& candidates, const Place& place, Method method, const StopTest& stop,
                                      std::span<const double> area, const Columns& reflectance,
                                      const Columns& emittance, Columns& radiosity, ProgressSink* progress = nullptr,
                                      double interval = 1.0, const std::function<void(Scheduler&)>& after = {});
/// The same with F as it is, in dense32.
[[nodiscard]] FallbackReport solve_on(Candidates& candidates, const FormFactorMatrix& form_factors, Method method,
                                      const StopTest& stop, std::span<const double> area, const Columns& reflectance,
                                      const Columns& emittance, Columns& radiosity, ProgressSink* progress = nullptr,
                                      double interval = 1.0, const std::function<void(Scheduler&)>& after = {});

}  // namespace interflect
