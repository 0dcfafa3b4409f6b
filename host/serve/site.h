#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "interflect/device/registry.h"
#include "interflect/serve/desk.h"
#include "interflect/serve/guard.h"
#include "interflect/serve/live_solver.h"

namespace interflect::serve {

/// The body of a solve's answer: a 32-bit length, so many bytes of JSON (padded with spaces to a multiple of 4), and
/// lit[G][N][3] in single precision: the radiosities of every light group alone. All little-endian.
[[nodiscard]] std::string solution_bytes(const LiveSolution& solution);

/// What lies under which path, and what it answers:
///   GET /         the page
///   GET /scene    JSON: materials that can be changed, tolerance, device, storage
///   GET /devices  JSON: the machine's devices
///   POST /solve   a change (SolveRequest) -> solution_bytes()
///   POST /device  {"device": ID} -> JSON; 409 when it fails, and the old one stays
/// Nothing else: no path is looked up among files.
class Site {
 public:
  using ListDevices = std::function<std::vector<DeviceEntry>()>;

  /// What is given must outlive this. The solver is used by the thread that runs the desk, and by no other from now on.
  Site(Guard guard, std::string page, const LiveScene& scene, LiveSolver& solver, Desk& desk, double tolerance,
       ListDevices list);

  /// Of a request without its body: the refusal, where nothing in the body can help. Status 403, 404, 405 or 415.
  [[nodiscard]] std::optional<Answer> refuse(const Request& request) const;
  /// Calls `done` once, in any thread. For a request that is not refused.
  void answer(const Request& request, Desk::Done done);

 private:
  [[nodiscard]] std::string scene_json() const;
  [[nodiscard]] Answer devices_answer();
  [[nodiscard]] Answer device_answer(const std::string& id);
  void solve(const Request& request, Desk::Done done);

  Guard guard_;
  std::shared_ptr<const std::string> page_;
  const LiveScene& scene_;
  LiveSolver& solver_;
  Desk& desk_;
  double tolerance_;
  ListDevices list_;
  std::vector<DeviceEntry> devices_;  ///< empty: not asked for yet
};

}  // namespace interflect::serve
