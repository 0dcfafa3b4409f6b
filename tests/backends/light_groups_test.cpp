// Lamps told apart on every backend and in every place and format of F: what the groups give adds up to what all lamps
// give together.

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "backends/devices.h"
#include "formfactor/meshes.h"
#include "interflect/formfactor/iff_panels.h"
#include "interflect/formfactor/iff_store.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/schedule/device_form_factors.h"
#include "interflect/solver/batches.h"
#include "interflect/solver/bounces.h"
#include "interflect/solver/fallback.h"

namespace interflect {
namespace {

using namespace test;

constexpr std::size_t groups = 9;  // 27 columns: a batch of 24 and one of 3

PatchMesh room() {
  return Builder()
      .part("room")
      .box({0, 0, 0}, {4, 3, 2.5}, true, 4)
      .part("box")
      .box({1, 1, 0.5}, {2, 2, 1.5}, false, 2)
      .mesh();
}

struct Light {
  Columns reflectance, emittance, all;  ///< all: every lamp on, three columns
};

Light light_of(const PatchMesh& mesh) {
  const std::vector<float> dark(mesh.size());
  Light light{Columns(3, dark), Columns(3 * groups, dark), Columns(3, dark)};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < mesh.size(); ++i) {
      light.reflectance[c][i] = 0.3F + 0.2F * static_cast<float>(c);
      if (i % 5 != 0) continue;
      const float e = static_cast<float>(1 + c + i % 4);
      light.all[c][i] = e;
      light.emittance[3 * (i / 5 % groups) + c][i] = e;
    }
  }
  return light;
}

Columns solved(Scheduler& scheduler, const PatchMesh& mesh, const Light& light, const Columns& emittance) {
  const StopTest stop{.tolerance = 1e-6};
  BatchedSolve batches(Method::cg, stop, mesh.area, light.reflectance, emittance);
  batches.run(scheduler);
  const SolveReport report = batches.report();
  EXPECT_TRUE(report.converged) << report.reason;
  EXPECT_EQ(report.relative_residual.size(), emittance.size());
  return batches.radiosity();
}

/// The largest difference between Σ_g and b, as a share of the largest b; group `left_out` is not added.
double sum_off(const Columns& by_group, const Columns& b, std::size_t left_out = groups) {
  double off = 0, largest = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < b[c].size(); ++i) {
      double sum = 0;
      for (std::size_t g = 0; g < groups; ++g) {
        if (g != left_out) sum += static_cast<double>(by_group[3 * g + c][i]);
      }
      const double d = std::abs(sum - static_cast<double>(b[c][i]));
      off = d <= off ? off : d;  // takes a NaN
      largest = std::max(largest, std::abs(static_cast<double>(b[c][i])));
    }
  }
  return off / largest;
}

/// Groups and all lamps on one Scheduler, which is used with 24 columns and with three.
void expect_the_sum(Scheduler& scheduler, const PatchMesh& mesh) {
  const Light light = light_of(mesh);
  const Columns by_group = solved(scheduler, mesh, light, light.emittance);
  scheduler.use_columns(3);
  Columns all;
  const SolveReport report =
      solve(scheduler, Method::cg, {.tolerance = 1e-6}, mesh.area, light.reflectance, light.all, all);
  EXPECT_TRUE(report.converged) << report.reason;
  EXPECT_LT(sum_off(by_group, all), 1e-5);
  for (const std::size_t g : {std::size_t{0}, std::size_t{7}, groups - 1}) {
    EXPECT_GT(sum_off(by_group, all, g), 1e-2) << "twin: group " << g << " left out";
  }
  // And bounce by bounce: after many the series is the solution.
  const std::vector<Columns> series = bounce_series(scheduler, light.reflectance, light.emittance, 40);
  EXPECT_EQ(series.front(), light.emittance);
  EXPECT_LT(sum_off(series.back(), all), 1e-5);
  EXPECT_GT(sum_off(series[2], all), 1e-2);
}

std::vector<std::unique_ptr<Device>> only(std::unique_ptr<Device> device) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::move(device));
  return devices;
}

class LightGroupsOn : public OnDevice {};

TEST_P(LightGroupsOn, AddUpInDense32) {
  const PatchMesh mesh = room();
  const FormFactors factors = assemble(mesh);
  Scheduler scheduler(factors.matrix, only(std::move(device)), columns_at_once(3 * groups));
  expect_the_sum(scheduler, mesh);
}

TEST_P(LightGroupsOn, AddUpIn16Bits) {
  const PatchMesh mesh = room();
  const FormFactors factors = assemble(mesh);
  for (const Storage storage : {Storage::dense16, Storage::tiled16, Storage::sym16}) {
    SCOPED_TRACE(name(storage));
    PackedMatrix::Options options;
    options.block = 128;
    if (storage != Storage::dense16) options.order = patch_order(mesh, factors.matrix);
    const PackedMatrix packed(factors.matrix, mesh.area, storage, std::move(options));
    if (device == nullptr) device = open_device(GetParam());
    Scheduler scheduler(packed, only(std::move(device)), columns_at_once(3 * groups));
    expect_the_sum(scheduler, mesh);
  }
}

TEST_P(LightGroupsOn, AddUpWhereTheDeviceHasMadeF) {
  if (std::string(GetParam()) == "openmp") GTEST_SKIP() << "F is made on the host there";
  const PatchMesh mesh = room();
  DeviceFormFactors factors(std::move(device), mesh);
  Scheduler scheduler(std::move(factors), columns_at_once(3 * groups));
  expect_the_sum(scheduler, mesh);
}

TEST_P(LightGroupsOn, AddUpWherePanelsStream) {
  const PatchMesh mesh = room();
  const std::string folder = testing::TempDir() + "groups" + std::to_string(::getpid()) + test_name({GetParam(), 0});
  std::filesystem::create_directories(folder);
  const std::uint64_t memory = FormFactorMatrix::predicted_bytes(mesh.size()) / 2;
  ::setenv("INTERFLECT_MAX_PANEL_BYTES", "40000", 1);
  AssemblyReport report;
  {
    IffStore store(folder + "/room.iff", iff_shape(mesh, 1, false, 5e-3, 1), {});
    report = assemble_into(store, mesh, {}, memory);
    store.finish(iff_closing(mesh, std::vector<Material>(64), Closure::automatic, report));
  }
  ::unsetenv("INTERFLECT_MAX_PANEL_BYTES");
  {
    const IffPanels panels(IffFile::open(folder + "/room.iff"));
    const StreamedMatrix streamed(panels, mesh.area, report.scaling, memory);
    Scheduler scheduler(streamed, only(std::move(device)), columns_at_once(3 * groups));
    expect_the_sum(scheduler, mesh);
    EXPECT_GT(streamed.stream().use().bytes_read, 0U);
  }
  std::filesystem::remove_all(folder);
}

INSTANTIATE_TEST_SUITE_P(Devices, LightGroupsOn, testing::ValuesIn(tested_devices), test_name);

}  // namespace
}  // namespace interflect
