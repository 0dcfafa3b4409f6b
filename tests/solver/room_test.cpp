// The 9,680-patch room: the three methods agree, and CG needs few products where light bounces long.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "interflect/device/registry.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/solver/solver.h"
#include "solver/light.h"

namespace interflect {
namespace {

using test::difference;

constexpr std::size_t channels = 3;

class Room9680 : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const Scene scene = read_scene(std::string(INTERFLECT_SOURCE_DIR) + "/scenes/room-9680.obj");
    SubdivideOptions subdivision;
    subdivision.divide = 1;
    mesh_ = std::make_unique<PatchMesh>(subdivide(scene, subdivision));
    factors_ = std::make_unique<FormFactors>(assemble(*mesh_));
  }
  static void TearDownTestSuite() {
    factors_.reset();
    mesh_.reset();
  }

  struct Result {
    SolveReport report;
    Columns radiosity;
  };
  /// With the room's own paint, or with everything but the black painted in one reflectance.
  static Result solve_with(Method method, double paint = 0, double tolerance = 1e-6) {
    test::MeshLight light(*mesh_);
    if (paint > 0) light.reflectance.assign(channels, std::vector<float>(mesh_->size(), static_cast<float>(paint)));
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(open_device("openmp"));
    Scheduler scheduler(factors_->matrix, std::move(devices), channels);
    Result result;
    StopTest stop;
    stop.tolerance = tolerance;
    result.report = solve(scheduler, method, stop, mesh_->area, light.reflectance, light.emittance, result.radiosity);
    EXPECT_TRUE(result.report.converged) << name(method) << ": " << result.report.reason;
    return result;
  }

  static std::unique_ptr<PatchMesh> mesh_;
  static std::unique_ptr<FormFactors> factors_;
};
std::unique_ptr<PatchMesh> Room9680::mesh_;
std::unique_ptr<FormFactors> Room9680::factors_;

TEST_F(Room9680, TheMethodsAgreeAndCgNeedsFewProducts) {
  ASSERT_EQ(mesh_->size(), 9680U);
  for (const double paint : {0.0, 0.9}) {  // 0.9 is the paint of rrv's own room of this size
    const Result cg = solve_with(Method::cg, paint);
    const Result bicgstab = solve_with(Method::bicgstab, paint);
    const Result jacobi = solve_with(Method::jacobi, paint);
    EXPECT_LE(difference(cg.radiosity, jacobi.radiosity), 1e-5);
    EXPECT_LE(difference(bicgstab.radiosity, jacobi.radiosity), 1e-5);
    const double share = paint > 0 ? 0.4 : 1.0;  // the room's own darker paint needs few bounces by any method
    EXPECT_LE(cg.report.products, share * jacobi.report.products);
    RecordProperty("products_cg", static_cast<int>(cg.report.products));
    RecordProperty("products_jacobi", static_cast<int>(jacobi.report.products));
  }
  // The twin: a solution stopped at 1e-3 is not within 1e-5.
  EXPECT_GT(difference(solve_with(Method::cg).radiosity, solve_with(Method::jacobi, 0, 1e-3).radiosity), 1e-5);
}

}  // namespace
}  // namespace interflect
