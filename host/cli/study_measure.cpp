#include "study_measure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/packed_matrix.h"
#include "interflect/formfactor/patch_order.h"
#include "pipeline.h"
#include "study_loops.h"

namespace interflect::cli {

namespace {

// Of the largest radiosity: what separates two solutions of one system to 1e-6, and what rounding F to 16 bits may do.
constexpr double nearness = 1e-5, nearness_16_bits = 1e-4;

/// What the last pass of a contestant gave.
struct Answer {
  Columns radiosity;
  std::uint32_t iterations = 0, products = 0;
  bool converged = false;
  double residual = 0;
};
constexpr std::array packed_formats{Storage::dense16, Storage::tiled16, Storage::sym16};
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
  if (row.bytes == 0) row.bytes = bytes;  // else of its own storage
  row.bytes *= answer.products;
  if (reference == nullptr || reference.get() == &answer) {
    row.error = answer.residual;
    row.bound = StopTest{}.tolerance;
  } else {
    row.error = largest_difference(answer.radiosity, reference->radiosity);
    row.bound = row.storage == name(Storage::dense32) ? nearness : nearness_16_bits;
  }
  if (!answer.converged) {
    deny(row, "not converged");
  } else if (!(row.error <= row.bound)) {
    deny(row, reference.get() == &answer ? "not converged" : "differs from CG's answer");
  }
}

/// Adds one: `run` solves once, fills the answer and returns the seconds.
void add_contestant(Contest& contest, const BenchRow& row, const std::string& reference_key,
                    const std::function<std::function<double(Answer&)>()>& prepare) {
  const auto answer = std::make_shared<Answer>();
  contest.answers[StudyRoom::key(row.device, row.what)] = answer;
  add(contest.all, row, [&]() -> Timed {
    return {.pass = [answer, run = prepare()] { return run(*answer); },
            .verify =
                [answer, &contest, reference_key](BenchRow& judged) {
                  judge(judged, *answer, contest.answers[reference_key], contest.factors.matrix.bytes());
                }};
  });
}

std::function<double(Answer&)> solving(const Contest& contest, const std::shared_ptr<Scheduler>& place, Method method) {
  return [place, method, &contest](Answer& answer) {
    const SolveReport report = solve(*place, method, StopTest{}, contest.scene.mesh.area, contest.light.reflectance,
                                     contest.light.emittance, answer.radiosity);
    answer.iterations = report.iterations;
    answer.products = report.products;
    answer.converged = report.converged;
    answer.residual = *std::max_element(report.relative_residual.begin(), report.relative_residual.end());
    return report.seconds;
  };
}

[[nodiscard]] std::vector<std::unique_ptr<Device>> opened(const std::string& id) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device(id));
  return devices;
}

/// A device or a kernel that is not there is no failure of what is measured.
template <class Act>
auto absent_is_a_limit(Act act) {
  try {
    return act();
  } catch (const Error& error) {
    throw Error(ErrorKind::limit, error.what());
  }
}

/// F on a device; rows that say why it is not there, where it is not.
void add_device(Contest& contest, const std::string& id, const std::vector<Method>& methods,
                const std::string& reference_key) {
  std::shared_ptr<Scheduler> place;
  for (const Method method : methods) {
    const BenchRow row = contest.row(id, "solve:" + std::string(name(method)));
    add_contestant(contest, row, reference_key, [&] {
      if (place == nullptr) {
        auto devices = absent_is_a_limit([&] { return opened(id); });
        place = std::make_shared<Scheduler>(contest.factors.matrix, std::move(devices), 3);
      }
      return solving(contest, place, method);
    });
  }
}

/// F in 16 bits and CG on a device, where the device has the format's kernels.
void add_packed(Contest& contest, const std::string& id, Storage storage, std::span<const std::uint32_t> order,
                const std::string& reference_key) {
  BenchRow row = contest.row(id, "solve:cg:" + std::string(name(storage)));
  row.storage = name(storage);
  const auto packed = std::make_shared<PackedMatrix>(contest.factors.matrix, contest.scene.mesh.area, storage,
                                                     PackedMatrix::Options{.order = {order.begin(), order.end()}});
  row.bytes = packed->bytes();
  add_contestant(contest, row, reference_key, [&]() -> std::function<double(Answer&)> {
    const auto place = absent_is_a_limit([&] { return std::make_shared<Scheduler>(*packed, opened(id), 3); });
    return [packed, place, run = solving(contest, place, Method::cg)](Answer& answer) { return run(answer); };
  });
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
  add_contestant(contest, contest.row("host", what), reference_key, [&] { return run; });
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

std::string StudyRoom::best_cg(const std::string& device) const {
  std::string best = "solve:cg";
  for (const Storage storage : packed_formats) {
    const std::string what = "solve:cg:" + std::string(name(storage));
    const Measurement *one = passed(device, what), *other = passed(device, best);
    if (one != nullptr && (other == nullptr || one->row.seconds < other->row.seconds)) best = what;
  }
  return best;
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
  const std::vector<std::uint32_t> order = patch_order(contest.scene.mesh, contest.factors.matrix);
  for (const Storage storage : packed_formats) add_packed(contest, device, storage, order, reference);
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
