// What more columns cost: products of 1 to 24 columns of one matrix, each storage and device, in turn, as multiples of
// the product of three columns. And what dropping a column once it has converged could save: the iterations of every
// column of every light group (by object), solved alone, beside those of all columns together.
//
//   columns_bench SCENE DIVIDE [DEVICE,... [STORAGE,... [REPETITIONS]]]
//   default openmp, dense32,dense16,tiled16,sym16, 9 repetitions

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/packed_matrix.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/scene/light_groups.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/schedule/storage_choice.h"
#include "interflect/solver/solver.h"

namespace {

using namespace interflect;

constexpr std::array<std::uint32_t, 8> counts{1, 3, 6, 9, 12, 15, 18, 24};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == ',') {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

void measure(const PatchMesh& mesh, const FormFactorMatrix& matrix, const std::string& id, Storage storage,
             int repetitions) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device(id));
  std::unique_ptr<PackedMatrix> packed;
  std::unique_ptr<Scheduler> scheduler;
  if (storage == Storage::dense32) {
    scheduler = std::make_unique<Scheduler>(matrix, std::move(devices), counts.back());
  } else {
    PackedMatrix::Options options;
    options.block = sym16_block(devices.front()->info(), matrix.size());
    if (storage != Storage::dense16) options.order = patch_order(mesh, matrix);
    packed = std::make_unique<PackedMatrix>(matrix, mesh.area, storage, std::move(options));
    scheduler = std::make_unique<Scheduler>(*packed, std::move(devices), counts.back());
  }
  std::array<std::vector<double>, counts.size()> seconds;
  for (int k = -1; k < repetitions; ++k) {  // the first pass is not counted
    for (std::size_t c = 0; c < counts.size(); ++c) {
      scheduler->use_columns(counts[c]);
      Vector x = scheduler->vector(), y = scheduler->vector();
      scheduler->upload(x, Columns(counts[c], std::vector<float>(mesh.size(), 1.0F)));
      scheduler->apply(x, y);
      scheduler->wait();
      const Timer timer;
      scheduler->apply(x, y);
      scheduler->wait();
      if (k >= 0) seconds[c].push_back(timer.seconds());
    }
  }
  const double three = median(seconds[1]);
  fmt::print("{:<10} {:<8} {:6} patches  3 columns {:9.3f} ms ", id, name(storage), mesh.size(), 1e3 * three);
  for (std::size_t c = 0; c < counts.size(); ++c) fmt::print(" {}: {:.2f}x", counts[c], median(seconds[c]) / three);
  fmt::print("\n");
  std::fflush(stdout);
}

void count_iterations(const Scene& scene, const PatchMesh& mesh, const FormFactorMatrix& matrix) {
  const LightGroups groups = light_groups(scene, mesh, "object");
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device("openmp"));
  Scheduler scheduler(matrix, std::move(devices), 1);
  for (const double tolerance : {1e-4, 1e-6, 1e-7}) {
    std::uint32_t most = 0, all = 0, columns = 0, passes = 0;
    std::string list;
    for (std::uint32_t g = 0; g < groups.names.size(); ++g) {
      for (std::size_t c = 0; c < 3; ++c) {
        Columns rho(1, std::vector<float>(mesh.size())), e = rho, b;
        for (std::size_t i = 0; i < mesh.size(); ++i) {
          rho[0][i] = static_cast<float>(mesh.reflectance[i][c]);
          if (groups.of_patch[i] == g) e[0][i] = static_cast<float>(mesh.emittance[i][c]);
        }
        const SolveReport report = solve(scheduler, Method::cg, {.tolerance = tolerance}, mesh.area, rho, e, b);
        list += fmt::format(" {}", report.iterations);
        most = std::max(most, report.iterations);
        passes = std::max(passes, report.passes);
        all += report.iterations;
        ++columns;
      }
    }
    if (columns == 0) return;
    fmt::print(
        "cg to {:g}: iterations of each column{}; at most {} passes; together {} x {}, dropping would leave {:.1f} %\n",
        tolerance, list, passes, columns, most, 100.0 * all / (columns * most));
  }
}

int run(int argc, char** argv) {
  if (argc < 3) throw Error(ErrorKind::usage, "columns_bench SCENE DIVIDE [DEVICE,... [STORAGE,... [REPETITIONS]]]");
  const auto devices = split(argc > 3 ? argv[3] : "openmp");
  const auto storages = split(argc > 4 ? argv[4] : "dense32,dense16,tiled16,sym16");
  const int repetitions = argc > 5 ? std::max(1, std::atoi(argv[5])) : 9;
  const Scene scene = read_scene(argv[1]);
  const PatchMesh mesh = subdivide(scene, {.divide = std::strtod(argv[2], nullptr)});
  AssemblyOptions options;
  options.budget = budget_of(accuracy_of("low"));
  const FormFactors factors = assemble(mesh, options);
  count_iterations(scene, mesh, factors.matrix);
  for (const std::string& id : devices) {
    for (const std::string& storage : storages) {
      measure(mesh, factors.matrix, id, storage_of(storage).value(), repetitions);
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const interflect::Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return exit_status(error.kind());
  }
}
