#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/solver/problem.h"
#include "interflect/solver/refinement.h"
#include "interflect/solver/solver.h"

namespace interflect {

std::string_view name(Method method) {
  switch (method) {
    case Method::cg: return "cg";
    case Method::bicgstab: return "bicgstab";
    case Method::jacobi: return "jacobi";
  }
  return "?";
}

SolveReport solve(Scheduler& scheduler, Method method, const StopTest& stop, std::span<const double> area,
                  const Columns& reflectance, const Columns& emittance, Columns& radiosity, ProgressSink* progress,
                  Checkpoint* checkpoint) {
  const Timer timer;
  if (!(stop.tolerance >= 0.0) || !std::isfinite(stop.tolerance)) {
    throw Error(ErrorKind::usage, fmt::format("the tolerance is {}, it must be 0 or more", stop.tolerance));
  }
  const Problem problem(scheduler, area, reflectance, emittance);
  const std::uint64_t products_before = scheduler.products();
  const double compiled_before = scheduler.compile_seconds();
  SolveReport report;
  Bar bar(progress, "Solve");
  Refinement refinement(scheduler, method, stop, problem, bar, report);
  const auto count_all = [&] {
    const auto products = static_cast<std::uint32_t>(scheduler.products() - products_before);
    report.products = products + (checkpoint != nullptr ? checkpoint->products : 0);
    report.seconds = timer.seconds() - (scheduler.compile_seconds() - compiled_before) +
                     (checkpoint != nullptr ? checkpoint->seconds : 0);
  };
  if (checkpoint != nullptr && checkpoint->keep) {
    refinement.keep = [&](const Columns& b, std::uint32_t made) {
      count_all();
      checkpoint->keep(b, made, report);
    };
  }
  refinement.begin(emittance, checkpoint);
  try {
    refinement.run();
  } catch (const Error&) {
    if (checkpoint != nullptr) {
      count_all();
      refinement.leave(*checkpoint);
      checkpoint->products = report.products;
      checkpoint->seconds = report.seconds;
    }
    throw;
  }
  radiosity = std::move(refinement.b());
  count_all();
  return report;
}

}  // namespace interflect
