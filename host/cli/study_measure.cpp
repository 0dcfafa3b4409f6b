#include "study_measure.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "pipeline.h"
#include "study_loops.h"

namespace interflect::cli {

namespace {

constexpr double nearness = 1e-5;  // of the largest radiosity

/// What the last pass of a contestant gave.
struct Answer {
  Columns radiosity;
  std::uint32_t iterations = 0, products = 0;
  bool converged = false;
  double residual = 0;
};
using SharedAnswer = std::shared_ptr<Answer>;

/// F of a room and the light in it, with everything that is made of them for the contest.
struct Contest {
  MeshedScene scene;
  FormFactors factors;
  Light light;
  std::map<std::string, SharedAnswer> answers;
  std::vector<Measurement> all;

  [[nodiscard]] BenchRow row(const std::string& device, const std::string& what) const {
    BenchRow made;
    made.device = device;
    made.what = what;
    made.scene = scene.scene.name;
    made.storage = std::string(name(factors.matrix.storage()));
    made.n = factors.matrix.size();
    made.columns = 3;
    return made;
  }
};

/// CG's answer on the device of the first table is what all others are held against; its own residual, in double, is
/// what it is held against itself.
void judge(BenchRow& row, const Answer& answer, const SharedAnswer& reference, std::uint64_t bytes) {
  row.products = answer.products;
  row.bytes = answer.products * bytes;
  if (reference == nullptr || reference.get() == &answer) {
    row.error = answer.residual;
    row.bound = StopTest{}.tolerance;
  } else {
    row.error = largest_difference(answer.radiosity, reference->radiosity);
    row.bound = nearness;
  }
  if (!answer.converged) {
    deny(row, "not converged");
  } else if (!(row.error <= row.bound)) {
    deny(row, reference.get() == &answer ? "not converged" : "differs from CG's answer");
  }
}

/// Adds one: `run` solves once, fills the answer and returns the seconds.
void add_contestant(Contest& contest, const std::string& device, const std::string& what,
                    const std::string& reference_key, const std::function<std::function<double(Answer&)>()>& prepare) {
  const auto answer = std::make_shared<Answer>();
  contest.answers[StudyRoom::key(device, what)] = answer;
  add(contest.all, contest.row(device, what), [&]() -> Timed {
    return {.pass = [answer, run = prepare()] { return run(*answer); },
            .verify =
                [answer, &contest, reference_key](BenchRow& judged) {
                  judge(judged, *answer, contest.answers[reference_key], contest.factors.matrix.bytes());
                }};
  });
}

void add_solve(Contest& contest, const std::shared_ptr<Scheduler>& place, const std::string& device, Method method,
               const std::string& reference_key) {
  const auto run = [place, method, &contest](Answer& answer) {
    const SolveReport report = solve(*place, method, StopTest{}, contest.scene.mesh.area, contest.light.reflectance,
                                     contest.light.emittance, answer.radiosity);
    answer.iterations = report.iterations;
    answer.products = report.products;
    answer.converged = report.converged;
    answer.residual = *std::max_element(report.relative_residual.begin(), report.relative_residual.end());
    return report.seconds;
  };
  add_contestant(contest, device, "solve:" + std::string(name(method)), reference_key, [&] { return run; });
}

/// F on a device; a row that says why it is not there, where it is not.
void add_device(Contest& contest, const std::string& id, const std::vector<Method>& methods,
                const std::string& reference_key) {
  try {
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(open_device(id));
    const auto place = std::make_shared<Scheduler>(contest.factors.matrix, std::move(devices), 3);
    for (const Method method : methods) add_solve(contest, place, id, method, reference_key);
  } catch (const Error& error) {
    for (const Method method : methods) {
      add_contestant(contest, id, "solve:" + std::string(name(method)), reference_key,
                     [&]() -> std::function<double(Answer&)> { throw Error(ErrorKind::limit, error.what()); });
    }
  }
}

void add_loop(Contest& contest, VectorLayout layout, bool parallel, const std::string& reference_key) {
  const std::string what =
      std::string("study:") + (layout == VectorLayout::aos ? "aos-" : "soa-") + (parallel ? "openmp" : "serial");
  const auto run = [&contest, layout, parallel](Answer& answer) {
    const LoopReport report = plain_jacobi(contest.factors.matrix, contest.light.reflectance, contest.light.emittance,
                                           layout, parallel, StopTest{}, answer.radiosity);
    answer.iterations = answer.products = report.iterations;
    answer.converged = report.converged;
    return report.seconds;
  };
  add_contestant(contest, "host", what, reference_key, [&] { return run; });
}

}  // namespace

double largest_difference(const Columns& a, const Columns& b) {
  if (a.size() != b.size()) return NAN;
  double difference = 0, largest = 0;
  for (std::size_t c = 0; c < b.size(); ++c) {
    if (a[c].size() != b[c].size()) return NAN;
    for (std::size_t i = 0; i < b[c].size(); ++i) {
      const double here = std::abs(static_cast<double>(a[c][i]) - static_cast<double>(b[c][i]));
      difference = here <= difference ? difference : here;  // also takes a NaN
      largest = std::max(largest, std::abs(static_cast<double>(b[c][i])));
    }
  }
  return largest > 0 ? difference / largest : difference;
}

const Measurement* StudyRoom::passed(std::string_view device, std::string_view what) const {
  const Measurement* found = find(all, device, what);
  return found != nullptr && found->row.status == "pass" ? found : nullptr;
}

StudyRoom measure_study_room(const std::string& folder, const Room& room, const std::string& device,
                             unsigned repetitions, ProgressSink& progress) {
  SceneOptions options;
  options.file = (std::filesystem::path(folder) / room.file).string();
  options.divide = room.divide;
  MeshedScene scene = load(options, progress);
  FormFactors factors = assemble_checked(scene, options, progress);
  Light light = light_of(scene.mesh);
  Contest contest{std::move(scene), std::move(factors), std::move(light), {}, {}};
  const std::string reference = StudyRoom::key(device, "solve:cg");

  add_device(contest, device, {Method::cg, Method::jacobi, Method::bicgstab}, reference);
  if (device != "openmp") add_device(contest, "openmp", {Method::cg, Method::jacobi}, reference);
  if (device != "cuda:0") add_device(contest, "cuda:0", {Method::cg, Method::jacobi}, reference);
  for (const VectorLayout layout : {VectorLayout::aos, VectorLayout::soa}) {
    for (const bool parallel : {false, true}) add_loop(contest, layout, parallel, reference);
  }
  measure(contest.all, repetitions);

  StudyRoom out{.scene = contest.scene.scene.name,
                .patches = contest.factors.matrix.size(),
                .form_factor_seconds = contest.factors.report.seconds,
                .all = {},
                .iterations = {}};
  for (Measurement& one : contest.all) one.timed = {};  // what it holds of the contest goes with the contest
  out.all = std::move(contest.all);
  for (const auto& [key, answer] : contest.answers) out.iterations[key] = answer->iterations;
  return out;
}

}  // namespace interflect::cli
