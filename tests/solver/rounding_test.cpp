#include "interflect/solver/rounding.h"

#include <gtest/gtest.h>

#include <cmath>

#include "interflect/formfactor/patch_order.h"
#include "interflect/schedule/storage_choice.h"
#include "interflect/solver/solver.h"
#include "schedule/counting_device.h"
#include "solver/light.h"
#include "solver/room.h"

namespace interflect {
namespace {

using namespace test;

struct Result {
  Columns radiosity;
  double claimed = 0;  ///< rounding_error()
  std::uint32_t products = 0;
};

template <class Matrix>
Result solved(const Matrix& f, const Room& room, const Light& light, Method method) {
  Scheduler scheduler(f, openmp(), 3);
  Result result;
  const SolveReport report =
      solve(scheduler, method, StopTest{}, room.area, light.reflectance, light.emittance, result.radiosity);
  EXPECT_TRUE(report.converged) << report.reason;
  result.products = report.products;
  result.claimed = rounding_error(scheduler, method, room.form_factors, room.area, light.reflectance, light.emittance,
                                  result.radiosity);
  return result;
}

TEST(Rounding, IsWhatADense32SolveShowsInEveryFormatAndMethod) {
  const Room room = make_room(9, 4);
  const Light light = lamp_light(room, 0.8F);
  const Result dense = solved(room.form_factors, room, light, Method::cg);
  EXPECT_LT(dense.claimed, 2e-6) << "nothing is rounded";
  for (const Storage storage : {Storage::dense16, Storage::tiled16, Storage::sym16}) {
    PackedMatrix::Options options;
    options.order = patch_order(room.form_factors);
    const PackedMatrix f(room.form_factors, room.area, storage, options);
    for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
      const Result result = solved(f, room, light, method);
      const double seen = difference(result.radiosity, dense.radiosity);
      EXPECT_NEAR(result.claimed, seen, 0.05 * seen + 2e-6) << name(storage) << " " << name(method);
      EXPECT_LT(seen, largest_rounding_error) << name(storage);
      EXPECT_GT(seen, 2e-6) << name(storage) << " rounds, and that must show";
    }
    // CG needs a symmetric matrix: rounding must not cost it its few products.
    EXPECT_LE(solved(f, room, light, Method::cg).products, dense.products + 1) << name(storage);
  }
}

/// The twin: a format that got its elements wrong is far above what is allowed.
TEST(Rounding, AWrongMatrixIsSeen) {
  const Room room = make_room(6, 3);
  const Light light = lamp_light(room, 0.8F);
  FormFactorMatrix wrong = repanelled(room.form_factors, std::uint64_t{1} << 30);
  for (float& value : wrong.row(3)) value *= 1.01F;
  const Result result = solved(PackedMatrix(wrong, room.area, Storage::tiled16), room, light, Method::bicgstab);
  EXPECT_GT(result.claimed, largest_rounding_error);
}

/// Where nearly all light is kept, rounding is magnified: by 1 / (1 - reflectance).
TEST(Rounding, GrowsWithTheReflectance) {
  const Room room = make_room(6, 3);
  const auto error = [&](float bright) {
    const Light light = lamp_light(room, bright);
    return solved(PackedMatrix(room.form_factors, room.area, Storage::sym16), room, light, Method::cg).claimed;
  };
  EXPECT_GT(error(0.999F), 3 * error(0.5F));
}

}  // namespace
}  // namespace interflect
