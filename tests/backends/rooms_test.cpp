// The four rooms of scenes/: every device and method gives the radiosities that OpenMP gives, in as many bounces.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>

#include "backends/devices.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/schedule/storage_choice.h"
#include "interflect/solver/rounding.h"
#include "interflect/solver/solver.h"
#include "sanitized.h"
#include "solver/light.h"

namespace interflect {
namespace {

using test::difference;
using test::MeshLight;

constexpr std::size_t channels = 3;
constexpr double bound = 2e-5;  // of the largest radiosity

struct Room {
  explicit Room(std::uint32_t patches)
      : mesh(subdivide(
            read_scene(std::string(INTERFLECT_SOURCE_DIR) + "/scenes/room-" + std::to_string(patches) + ".obj"),
            {.divide = 1.0})),
        factors(assemble(mesh)) {}
  PatchMesh mesh;
  FormFactors factors;
};

struct Result {
  SolveReport report;
  double rounding = 0;  ///< rounding_error() of a 16-bit format
  Columns radiosity;
};

std::unique_ptr<Scheduler> place(const std::string& id, const Room& room, const PackedMatrix* packed) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device(id));
  if (packed != nullptr) return std::make_unique<Scheduler>(*packed, std::move(devices), channels);
  return std::make_unique<Scheduler>(room.factors.matrix, std::move(devices), channels);
}

Result solve_on(const std::string& id, const Room& room, Method method, const PackedMatrix* packed = nullptr) {
  const MeshLight light(room.mesh);
  const std::unique_ptr<Scheduler> scheduler = place(id, room, packed);
  Result result;
  result.report =
      solve(*scheduler, method, StopTest{}, room.mesh.area, light.reflectance, light.emittance, result.radiosity);
  result.rounding = packed == nullptr ? 0
                                      : rounding_error(*scheduler, method, room.factors.matrix, room.mesh.area,
                                                       light.reflectance, light.emittance, result.radiosity);
  EXPECT_TRUE(result.report.converged) << id << " " << name(method) << ": " << result.report.reason;
  return result;
}

void compare_devices(const Room& room) {
  constexpr Method methods[] = {Method::cg, Method::bicgstab, Method::jacobi};
  std::map<Method, Result> openmp;
  for (const Method method : methods) openmp.emplace(method, solve_on("openmp", room, method));
  for (const char* id : test::tested_devices) {
    const std::string why = test::why_unavailable(id);
    if (!why.empty()) {
      EXPECT_FALSE(test::required(id)) << why;
      std::printf("%s is not compared: %s\n", id, why.c_str());
      continue;
    }
    for (const Method method : methods) {
      const Result result = solve_on(id, room, method);
      EXPECT_LE(difference(result.radiosity, openmp.at(method).radiosity), bound) << id << " " << name(method);
      if (method != Method::jacobi) continue;
      EXPECT_NEAR(result.report.iterations, openmp.at(method).report.iterations, 1) << id;
    }
  }
}

/// Every 16-bit format on every device: the same as on OpenMP, and as near to dense32 as is allowed and as is claimed.
void compare_formats(const Room& room) {
  const Result dense = solve_on("openmp", room, Method::cg);
  const std::vector<std::uint32_t> order = patch_order(room.mesh, room.factors.matrix);
  for (const Storage storage : {Storage::dense16, Storage::tiled16, Storage::sym16}) {
    PackedMatrix::Options options;
    options.order = order;
    const PackedMatrix packed(room.factors.matrix, room.mesh.area, storage, options);
    const Result openmp = solve_on("openmp", room, Method::cg, &packed);
    for (const char* id : test::tested_devices) {
      if (!test::why_unavailable(id).empty()) continue;  // said by compare_devices()
      const Result result = solve_on(id, room, Method::cg, &packed);
      const double error = difference(result.radiosity, dense.radiosity);
      EXPECT_LE(difference(result.radiosity, openmp.radiosity), bound) << id << " " << name(storage);
      EXPECT_LE(error, largest_rounding_error) << id << " " << name(storage);
      EXPECT_NEAR(result.rounding, error, 0.1 * error + 3e-6) << id << " " << name(storage);
      EXPECT_LE(result.report.products, dense.report.products + 1) << id << " " << name(storage);
    }
    std::printf("%s: %.1f MB of %.1f, rounding moves a radiosity by %.1e of the largest\n",
                std::string(name(storage)).c_str(), static_cast<double>(packed.bytes()) * 1e-6,
                static_cast<double>(room.factors.matrix.bytes()) * 1e-6, openmp.rounding);
  }
}

class Rooms : public testing::TestWithParam<std::uint32_t> {};

TEST_P(Rooms, EveryDeviceAndMethodGivesTheSameLight) {
  if (test::sanitized && GetParam() > 3360) GTEST_SKIP() << "too large a room for a run under the sanitizers";
  const Room room(GetParam());
  ASSERT_EQ(room.mesh.size(), GetParam());
  compare_devices(room);
}

TEST_P(Rooms, EveryFormatGivesTheLightOfDense32) {
  if (test::sanitized && GetParam() > 3360) GTEST_SKIP() << "too large a room for a run under the sanitizers";
  compare_formats(Room(GetParam()));
}

INSTANTIATE_TEST_SUITE_P(All, Rooms, testing::Values(1312U, 3360U, 9680U, 17128U), testing::PrintToStringParamName());

TEST(SmallPanels, EveryDeviceAndMethodGivesTheSameLight) {
  ::setenv("INTERFLECT_MAX_PANEL_BYTES", "100000", 1);
  const Room room(1312);
  ::unsetenv("INTERFLECT_MAX_PANEL_BYTES");
  ASSERT_GT(room.factors.matrix.panels().size(), 50U);
  compare_devices(room);
}

/// A device whose products lose one of 1,312 columns is seen by the bound.
TEST(SmallPanels, ALostColumnIsSeen) {
  const Room room(1312);
  const Result whole = solve_on("openmp", room, Method::cg);
  FormFactorMatrix damaged(1312);
  for (std::uint32_t i = 0; i < 1312; ++i) {
    const auto from = room.factors.matrix.row(i);
    auto to = damaged.row(i);
    std::copy(from.begin(), from.end(), to.begin());
    to[1311] = 0;
  }
  Room broken(1312);
  broken.factors.matrix = std::move(damaged);
  const Result result = solve_on("openmp", broken, Method::jacobi);
  EXPECT_GT(difference(result.radiosity, whole.radiosity), bound);
}

}  // namespace
}  // namespace interflect
