#include "serve_measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <ctime>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/serve/site.h"

namespace interflect::cli {

namespace {

double processor_seconds() {
  timespec now{};
  if (::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) != 0) return 0;
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// The material with the largest area that does not emit.
std::size_t wall_of(const serve::LiveScene& scene) {
  const auto& materials = scene.materials();
  const auto reflecting = [](const serve::LiveMaterial& m) { return m.emits ? 0 : m.area; };
  const auto largest = std::max_element(materials.begin(), materials.end(),
                                        [&](const auto& a, const auto& b) { return reflecting(a) < reflecting(b); });
  if (largest == materials.end() || largest->emits) {
    throw Error(ErrorKind::input, "the scene has no material that only reflects");
  }
  return static_cast<std::size_t>(largest - materials.begin());
}

}  // namespace

LiveMeasurement measure_live(serve::LiveSolver& solver, const serve::LiveScene& scene, double tolerance,
                             double seconds) {
  constexpr double step = 0.1;
  const std::size_t wall = wall_of(scene);
  serve::Change one, other;
  one.tolerance = other.tolerance = tolerance;
  Rgb& changed = other.reflectance[wall] = scene.materials()[wall].reflectance;
  for (double& rho : changed) rho = rho >= step ? rho - step : rho + step;

  LiveMeasurement measured;
  measured.wall = scene.materials()[wall].name;
  solver.forget();
  const serve::LiveSolution cold = solver.solve(one);
  measured.cold_seconds = cold.seconds;
  measured.cold_products = cold.report.products;
  std::vector<double> times;
  double products = 0;
  const Timer all;
  const double before = processor_seconds();
  while (times.size() < 10 || all.seconds() < seconds) {
    const Timer timer;
    const serve::LiveSolution solution = solver.solve(times.size() % 2 == 0 ? other : one);
    static_cast<void>(serve::solution_bytes(solution));
    times.push_back(timer.seconds());
    products += solution.report.products;
    measured.converged = measured.converged && solution.report.converged;
  }
  const auto count = static_cast<double>(times.size());
  measured.solves = static_cast<std::uint32_t>(times.size());
  measured.processor_seconds = (processor_seconds() - before) / count;
  measured.products = products / count;
  std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2), times.end());
  measured.seconds = times[times.size() / 2];
  return measured;
}

std::string live_table_head() {
  return fmt::format("{:<14} {:>8} {:>6} {:>8} {:>10} {:>8} {:>9} {:>14} {:>14} {:>10} {:>10}\n", "scene", "patches",
                     "lamps", "columns", "device", "storage", "tolerance", "from 0", "after an edit", "CPU",
                     "solves/s");
}

std::string live_table_line(const std::string& scene, const serve::LiveScene& live, const serve::LiveSolution& last,
                            const LiveMeasurement& measured) {
  const auto cost = [](double products, double seconds) {
    return fmt::format("{:.3g} p {:.4g} ms", products, 1e3 * seconds);
  };
  return fmt::format("{:<14} {:>8} {:>6} {:>8} {:>10} {:>8} {:>9.0e} {:>14} {:>14} {:>7.4g} ms {:>10.3g}{}\n", scene,
                     live.mesh().size(), live.lamps(), 3 * live.lamps(), last.device, last.storage, last.tolerance,
                     cost(measured.cold_products, measured.cold_seconds), cost(measured.products, measured.seconds),
                     1e3 * measured.processor_seconds, 1 / measured.seconds,
                     measured.converged ? "" : "  NOT CONVERGED");
}

}  // namespace interflect::cli
