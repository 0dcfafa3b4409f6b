#include "study.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "pipeline.h"

namespace interflect::cli {

namespace {

/// Study, poster of 2014: scene, then Jacobi and BiCG-STAB iterations and OpenMP seconds.
struct StudyFigures {
  unsigned patches, jacobi_iterations, bicgstab_iterations;
  double jacobi_seconds, bicgstab_seconds;
};
constexpr std::array study_figures{StudyFigures{1312, 8, 3, 0.009, 0.010}, StudyFigures{3360, 28, 16, 0.045, 0.058},
                                   StudyFigures{9680, 36, 17, 0.410, 0.435}, StudyFigures{17128, 32, 17, 0.993, 1.157}};

constexpr std::array methods{Method::jacobi, Method::bicgstab, Method::cg};

struct MethodResult {
  std::vector<double> seconds;
  SolveReport report;
  std::vector<Rgb> radiosity;
};

double largest_difference(const std::vector<Rgb>& a, const std::vector<Rgb>& b) {
  double difference = 0, largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      difference = std::max(difference, std::abs(a[i][c] - b[i][c]));
      largest = std::max(largest, std::abs(b[i][c]));
    }
  }
  return largest > 0 ? difference / largest : difference;
}

bool right(const MethodResult& result, const MethodResult& reference) {
  return result.report.converged && largest_difference(result.radiosity, reference.radiosity) <= 1e-5;
}

std::string cell(const MethodResult& result, const MethodResult& reference) {
  if (!result.report.converged) return fmt::format("{:>4} not converged", result.report.iterations);
  const double difference = largest_difference(result.radiosity, reference.radiosity);
  if (!right(result, reference)) return fmt::format("{:>4} WRONG by {:.1e}", result.report.iterations, difference);
  return fmt::format("{:>4} {:>9.4f}", result.report.iterations, median(result.seconds));
}

}  // namespace

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

const std::vector<Room>& study_rooms() {
  static const std::vector<Room> rooms{
      {"room-1312.obj", 1312, 1}, {"room-3360.obj", 3360, 1}, {"room-9680.obj", 9680, 1}, {"room-17128.obj", 17128, 1}};
  return rooms;
}

std::string scenes_folder(const std::string& given) {
  std::vector<std::filesystem::path> candidates;
  if (!given.empty()) {
    candidates.emplace_back(given);
  } else {
    candidates.emplace_back("scenes");
    std::error_code ignored;
    const auto program = std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path();
    candidates.push_back(program / "../../../scenes");             // build/release/bin
    candidates.push_back(program / "../share/interflect/scenes");  // installed
  }
  for (const auto& folder : candidates) {
    if (std::filesystem::exists(folder / study_rooms().front().file)) return folder.string();
  }
  throw Error(ErrorKind::usage, fmt::format("{} is not found in {}; name the folder with --scenes",
                                            study_rooms().front().file, candidates.front().string()));
}

StudyTable study_table(const std::string& rooms, const std::string& device, unsigned repetitions,
                       ProgressSink& progress) {
  StudyTable out;
  out.text =
      "patches |  Jacobi it, s  |  BiCGSTAB it, s |    CG it, s    | study: Jacobi it, s | BiCG-STAB it, s | form "
      "factors, s\n";
  for (std::size_t k = 0; k < study_rooms().size(); ++k) {
    const Room& room = study_rooms()[k];
    const StudyFigures& then = study_figures.at(k);
    SceneOptions scene;
    scene.file = (std::filesystem::path(rooms) / room.file).string();
    scene.divide = room.divide;
    const MeshedScene loaded = load(scene, progress);
    const FormFactors factors = assemble_checked(loaded, scene, progress);
    std::array<MethodResult, methods.size()> results;
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(open_device(device));
    Scheduler scheduler(factors.matrix, std::move(devices), 3);
    for (unsigned r = 0; r < repetitions; ++r) {
      for (std::size_t m = 0; m < methods.size(); ++m) {
        Solved solved = solve_placed(scheduler, loaded.mesh, methods.at(m), StopTest{});
        results.at(m).seconds.push_back(solved.report.seconds);
        results.at(m).report = std::move(solved.report);
        results.at(m).radiosity = std::move(solved.radiosity);
      }
    }
    for (const MethodResult& result : results) out.verified = out.verified && right(result, results[2]);
    out.text += fmt::format("{:>7} | {} |  {} | {} | {:>12} {:>6.3f} | {:>8} {:>6.3f} | {:>9.2f}\n", loaded.mesh.size(),
                            cell(results[0], results[2]), cell(results[1], results[2]), cell(results[2], results[2]),
                            then.jacobi_iterations, then.jacobi_seconds, then.bicgstab_iterations,
                            then.bicgstab_seconds, factors.report.seconds);
  }
  return out;
}

}  // namespace interflect::cli
