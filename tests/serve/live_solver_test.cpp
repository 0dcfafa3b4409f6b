#include "interflect/serve/live_solver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "schedule/failing_device.h"
#include "solver/light.h"
#include "solver/room.h"

// Solving one room over and over: where it begins, what it gives, and devices that fail.

namespace interflect::serve {
namespace {

using test::difference;
using test::FailingDevice;
using test::Fate;
using ::testing::HasSubstr;

constexpr std::size_t walls = 0, lamp = 1, boxes = 2;  // in the order of their first patches

/// The test room with three materials; half of the boxes is darker, as a texture would have it.
struct Room {
  Room() : room(test::make_room(5, 2)) {
    const auto light = test::lamp_light(room, 0.7F);
    mesh.area = room.area;
    mesh.surfaces = {{"walls", "", 0}, {"boxes", "", 1}, {"lamp", "", 2}};
    for (std::size_t i = 0; i < room.patches.size(); ++i) {
      const bool emits = light.emittance[0][i] > 0, box = room.patches[i].surface >= 6;
      mesh.corners.push_back({});
      mesh.surface.push_back(emits ? 2 : box ? 1 : 0);
      mesh.reflectance.push_back(emits ? Rgb{} : box ? Rgb{i % 2 == 0 ? 0.2 : 0.4, 0.5, 0} : Rgb{0.7, 0.6, 0.5});
      mesh.emittance.push_back(emits ? Rgb{10, 8, 6} : Rgb{});
    }
  }
  test::Room room;
  PatchMesh mesh;
};

class LiveSolving : public ::testing::Test {
 protected:
  LiveSolver solver(std::vector<std::string> devices) {
    Placement placement;
    placement.open = [this](const std::string& id) -> std::unique_ptr<Device> {
      opened.push_back(id);
      if (id == "absent") throw device_error(id, "open", "not there");
      if (id == "failing") return std::make_unique<FailingDevice>(fate);
      return open_device(id);
    };
    placement.place = [this](std::unique_ptr<Device> device, std::uint32_t columns, bool) {
      std::vector<std::unique_ptr<Device>> list;
      list.push_back(std::move(device));
      return PlacedFormFactors{{}, std::make_unique<Scheduler>(room.room.form_factors, std::move(list), columns)};
    };
    return {scene, std::move(devices), std::move(placement), Method::cg, 200, 1e-6, quiet};
  }
  /// From nothing, by a solver of its own.
  Columns fresh(const Change& change) {
    LiveSolver other = solver({"openmp"});
    other.forget();
    return other.solve(change).radiosity;
  }

  Room room;
  LiveScene scene{room.mesh, {}, {"paint", "paint", "glow"}};
  std::shared_ptr<Fate> fate = std::make_shared<Fate>();
  std::vector<std::string> opened;
  ProgressSink quiet;
};

Change painted(double rho) {
  Change change;
  change.tolerance = 1e-6;
  change.reflectance[walls] = {rho, rho, rho};
  return change;
}

TEST_F(LiveSolving, MaterialsHaveNamesOfTheirOwnAndMeans) {
  ASSERT_EQ(scene.materials().size(), 3U);
  EXPECT_EQ(scene.materials()[walls].name, "paint");
  EXPECT_EQ(scene.materials()[boxes].name, "paint (2)");
  EXPECT_TRUE(scene.materials()[lamp].emits);
  EXPECT_TRUE(scene.materials()[boxes].varies);
  EXPECT_EQ(scene.materials()[walls].reflectance, (Rgb{0.7, 0.6, 0.5}));
  EXPECT_NEAR(scene.materials()[boxes].reflectance[1], 0.5, 1e-12);
}

TEST_F(LiveSolving, NamesAreWhatJsonCanSay) {
  const LiveScene latin(room.mesh, {}, {"w\xe4nde", "w\xf6nde", "gl\tow"});
  EXPECT_EQ(latin.materials()[walls].name, "w\xef\xbf\xbdnde");
  EXPECT_EQ(latin.materials()[boxes].name, "w\xef\xbf\xbdnde (2)");
  EXPECT_EQ(latin.materials()[lamp].name, "gl ow");
}

TEST_F(LiveSolving, WhatVariesIsScaledToTheNewMean) {
  Change change;
  const Rgb mean = scene.materials()[boxes].reflectance;
  change.reflectance[boxes] = {2 * mean[0], 0.1, 0.3};
  const Columns rho = scene.reflectance(change);
  for (std::size_t i = 0; i < room.mesh.size(); ++i) {
    if (room.mesh.surface[i] != 1) continue;
    EXPECT_NEAR(rho[0][i], 2 * room.mesh.reflectance[i][0], 1e-6);
    EXPECT_NEAR(rho[1][i], 0.1, 1e-6);
    EXPECT_NEAR(rho[2][i], 0.3, 1e-6);  // black before: nothing to scale
  }
  change.reflectance[boxes] = {1, 1, 1};
  const Columns full = scene.reflectance(change);
  for (const float value : full[0]) EXPECT_LE(value, 1.0F);
}

TEST_F(LiveSolving, IsWhatASolveFromNothingGives) {
  LiveSolver live = solver({"openmp"});
  for (const double rho : {0.7, 0.65, 0.1, 0.0, 0.9}) {
    const LiveSolution solution = live.solve(painted(rho));
    EXPECT_TRUE(solution.report.converged);
    EXPECT_TRUE(solution.warm);
    const Columns wanted = fresh(painted(rho));
    EXPECT_LT(difference(solution.radiosity, wanted), 1e-5) << rho;
    EXPECT_GT(difference(fresh(painted(rho + 0.005)), wanted), 1e-5) << rho;  // the twin
  }
  Change dimmed = painted(0.9);
  dimmed.emittance[lamp] = {1, 8, 0};
  EXPECT_LT(difference(live.solve(dimmed).radiosity, fresh(dimmed)), 1e-5);
}

TEST_F(LiveSolving, BeginsAtTheLastSolution) {
  LiveSolver live = solver({"openmp"});
  live.forget();
  const LiveSolution cold = live.solve(painted(0.6));
  EXPECT_FALSE(cold.warm);
  EXPECT_EQ(live.solve(painted(0.6)).report.products, 1U);  // nothing has changed: its residual is looked at
  EXPECT_LT(live.solve(painted(0.601)).report.products, cold.report.products);
  Change dimmed = painted(0.601);
  dimmed.emittance[lamp] = {5, 4, 3};
  EXPECT_EQ(live.solve(dimmed).report.products, 1U);  // all columns were scaled with their lamp
}

TEST_F(LiveSolving, ADeviceThatIsNotThereLeavesTheOldOne) {
  LiveSolver live = solver({"absent", "openmp"});
  EXPECT_EQ(live.device(), "openmp");
  const Columns before = live.solve(painted(0.5)).radiosity;
  EXPECT_THROW(live.use_device("absent"), Error);
  EXPECT_EQ(live.device(), "openmp");
  EXPECT_LT(difference(live.solve(painted(0.5)).radiosity, before), 1e-6);
}

TEST_F(LiveSolving, SaysWhichDeviceAutoTook) {
  LiveSolver live = solver({"openmp"});
  live.use_device("auto");
  EXPECT_EQ(opened.back(), "auto");
  EXPECT_EQ(live.device(), open_device("auto")->info().id);
  EXPECT_NE(live.device(), "auto");
}

TEST_F(LiveSolving, ADeviceThatFailsInItsFirstSolveLeavesTheOldOne) {
  LiveSolver live = solver({"openmp"});
  static_cast<void>(live.solve(painted(0.5)));
  fate->fails_at = 12;
  EXPECT_THROW(live.use_device("failing"), Error);
  EXPECT_GT(fate->calls, 12U);
  EXPECT_EQ(live.device(), "openmp");
  EXPECT_EQ(fate->live_buffers, 0);
  const LiveSolution solution = live.solve(painted(0.4));
  EXPECT_EQ(solution.device, "openmp");
  EXPECT_LT(difference(solution.radiosity, fresh(painted(0.4))), 1e-5);
}

TEST_F(LiveSolving, ADeviceThatFailsLaterIsFollowedByTheNext) {
  LiveSolver live = solver({"failing", "openmp"});
  EXPECT_EQ(live.device(), "failing");
  fate->fails_at = fate->calls + 10;
  const LiveSolution solution = live.solve(painted(0.4));
  EXPECT_EQ(solution.device, "openmp");
  EXPECT_EQ(live.device(), "openmp");
  EXPECT_THAT(solution.notice, HasSubstr("going on with openmp"));
  EXPECT_LT(difference(solution.radiosity, fresh(painted(0.4))), 1e-5);
  EXPECT_EQ(live.solve(painted(0.3)).notice, "");
}

TEST_F(LiveSolving, WithoutAnotherDeviceItSaysSoAndMayRecover) {
  LiveSolver live = solver({"failing"});
  fate->fails_at = fate->calls + 10;
  EXPECT_THROW(static_cast<void>(live.solve(painted(0.4))), Error);
  EXPECT_THROW(static_cast<void>(live.solve(painted(0.4))), Error);
  live.use_device("openmp");
  EXPECT_LT(difference(live.solve(painted(0.4)).radiosity, fresh(painted(0.4))), 1e-5);
}

}  // namespace
}  // namespace interflect::serve
