#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "formfactor/broken.h"
#include "interflect/formfactor/kernel.h"

namespace interflect {
namespace {

using test::blind;
using test::Builder;
using test::near;
using test::raw;
using test::scaled;

constexpr double plates = 1e-4, occluded = 5e-3;

/// Parallel unit squares at a distance.
Builder parallel(double distance, int n) {
  Builder b;
  b.part("low").plate({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, n);
  b.part("high").plate({0, 0, distance}, {0, 1, 0}, {1, 0, 0}, n);
  return b;
}

/// Two perpendicular plates of width 1, each `depth` deep, beginning `offset` from their common line.
Builder perpendicular(double depth, double offset, int n) {
  Builder b;
  b.part("floor").plate({0, offset, 0}, {1, 0, 0}, {0, depth, 0}, n);
  b.part("wall").plate({0, 0, offset}, {0, 0, depth}, {1, 0, 0}, n);
  // its front looks along z × x = +y, the floor's along +z
  return b;
}

struct Plates {
  const char* name;
  Builder (*make)(int);
  double exact;
};

class ExactPlates : public ::testing::TestWithParam<Plates> {};

TEST_P(ExactPlates, WithTwoTrianglesAPlateAndCut) {
  for (const int n : {1, 8}) {
    const Builder b = GetParam().make(n);
    const GroupFactors f = b.factors(raw());
    EXPECT_TRUE(near(f.factors[0][1], GetParam().exact, plates)) << n;
    EXPECT_TRUE(near(f.factors[1][0] * f.areas[1], GetParam().exact * f.areas[0], plates)) << n;
    EXPECT_EQ(f.factors[0][0], 0) << "a plane sees nothing of itself";
  }
}

/// Twin: the same bound finds a contour that leaves out one pair of edges, and one that is 1 % off.
TEST_P(ExactPlates, TheBoundFindsABrokenContour) {
  const Builder b = GetParam().make(1);
  const PatchMesh& mesh = b.mesh();
  double sound = 0, dropped = 0;
  for (std::size_t i : {0U, 1U}) {
    for (std::size_t j : {2U, 3U}) {
      const auto t = mesh.triangle(i), u = mesh.triangle(j);
      for (std::size_t k = 0; k < 3; ++k) {
        for (std::size_t m = 0; m < 3; ++m) {
          const double part = kernel::edge_pair(t[k], t[(k + 1) % 3], u[m], u[(m + 1) % 3]) / (2 * std::numbers::pi);
          sound += part;
          if (k != 0 || m != 0) dropped += part;
        }
      }
    }
  }
  const double area = mesh.area[0] + mesh.area[1];
  EXPECT_TRUE(near(sound / area, GetParam().exact, 1e-6));
  EXPECT_FALSE(near(dropped / area, GetParam().exact, plates)) << "an edge dropped";
  EXPECT_FALSE(near(scaled(b.factors(raw()), 1.01).factors[0][1], GetParam().exact, plates)) << "1 % off";
}

INSTANTIATE_TEST_SUITE_P(
    Catalogue, ExactPlates,
    ::testing::Values(Plates{"parallel_1", [](int n) { return parallel(1, n); }, 0.199824895698387},
                      Plates{"parallel_half", [](int n) { return parallel(0.5, n); }, 0.415253283577147},
                      Plates{"parallel_tenth", [](int n) { return parallel(0.1, n); }, 0.826994522397256},
                      Plates{"perpendicular", [](int n) { return perpendicular(1, 0, n); }, 0.200043776075403},
                      Plates{"perpendicular_shallow", [](int n) { return perpendicular(0.1, 0, n); },
                             0.281887806787901},
                      Plates{"perpendicular_deep", [](int n) { return perpendicular(10, 0, n); }, 0.055023979528411},
                      Plates{"perpendicular_apart", [](int n) { return perpendicular(1, 0.1, n); }, 0.154206868494109}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(Exact, APlateThatBlocksEverything) {
  for (const int n : {1, 4}) {
    Builder b = parallel(1, n);
    EXPECT_GT(b.factors(raw()).factors[0][1], 0.19);
    b.part("between").plate({-1, -1, 0.3}, {3, 0, 0}, {0, 3, 0}, n);
    const auto blocks = [](const GroupFactors& f) {
      const auto there = near(f.factors[0][1], 0, 0);
      return there ? near(f.factors[1][0], 0, 0) : there;
    };
    EXPECT_TRUE(blocks(b.factors(raw()))) << n;
    EXPECT_FALSE(blocks(blind(b))) << "twin: the rays see nothing";
  }
}

/// A wide screen that touches neither plate nor lets anything past x < ½: halves of the plates see each other around
/// its edge only through the plane of the screen, so by symmetry F with the screen's half-plane at mid height is
/// the measure of lines through its open half: half of F, since mirroring x ↔ 1 − x maps open lines to closed ones.
TEST(Exact, HalfAScreenHidesHalf) {
  for (const int n : {1, 8}) {
    Builder b = parallel(1, n);
    b.part("screen").plate({-3, -3, 0.5}, {3.5, 0, 0}, {0, 7, 0}, 1);
    const auto half = [](const GroupFactors& f) { return near(f.factors[0][1], 0.199824895698387 / 2, occluded); };
    EXPECT_TRUE(half(b.factors(raw()))) << n;
    EXPECT_FALSE(half(blind(b))) << "twin: the rays see nothing";
    Builder moved = parallel(1, n);  // twin: 0.05 too far, which hides 0.55 of the lines or so
    moved.part("screen").plate({-3, -3, 0.5}, {3.55, 0, 0}, {0, 7, 0}, 1);
    EXPECT_FALSE(half(moved.factors(raw()))) << n;
  }
}

/// A screen lying closely on the floor over x < ½: what remains is the open half alone, an unoccluded rectangle.
TEST(Exact, AScreenCloseToOneOfTwoCloseSurfaces) {
  constexpr double gap = 1e-3;
  Builder open;
  open.part("half").plate({0.5, 0, 0}, {0.5, 0, 0}, {0, 1, 0});
  open.part("high").plate({0, 0, 1}, {0, 1, 0}, {1, 0, 0});
  const double half = open.factors(raw()).factors[0][1];  // seen from the half; the whole floor gets half of it
  for (const int n : {1, 8}) {
    Builder b = parallel(1, n);
    b.part("screen").plate({-1, -1, gap}, {1.5, 0, 0}, {0, 3, 0}, 1);
    const auto holds = [&](const GroupFactors& f) { return near(f.factors[0][1], half / 2, occluded); };
    EXPECT_TRUE(holds(b.factors(raw()))) << n;
    EXPECT_FALSE(holds(blind(b))) << "twin: the rays see nothing";
  }
}

/// Row sums of a closed convex room within `bound` of 1, and its radiosity under e = 1, ρ = ½ within it of e / (1 − ρ).
::testing::AssertionResult furnace_holds(const FormFactorMatrix& f, double bound) {
  for (const double sum : f.row_sums()) {
    if (auto r = near(sum, 1, bound); !r) return r << ": a row sum";
  }
  std::vector<double> radiosity(f.size(), 1.0);
  for (int bounce = 0; bounce < 40; ++bounce) {
    std::vector<double> next(radiosity.size(), 1.0);
    for (std::uint32_t i = 0; i < f.size(); ++i) {
      for (std::size_t j = 0; j < next.size(); ++j) next[i] += 0.5 * static_cast<double>(f.row(i)[j]) * radiosity[j];
    }
    radiosity = next;
  }
  for (const double x : radiosity) {
    if (auto r = near(x / 2, 1, bound); !r) return r << ": a radiosity";
  }
  return ::testing::AssertionSuccess();
}

TEST(Exact, TheFurnaceIsClosed) {
  Builder b;
  b.part("cube").box({0, 0, 0}, {1, 1, 1}, true, 4);
  const FormFactors unscaled = assemble(b.mesh(), raw());
  EXPECT_TRUE(furnace_holds(unscaled.matrix, plates));
  const FormFactors f = assemble(b.mesh());
  EXPECT_TRUE(f.report.closed_scene);
  EXPECT_TRUE(f.report.closure_applied);
  EXPECT_TRUE(f.report.set_aside.empty());
  EXPECT_TRUE(furnace_holds(f.matrix, 1e-4));
  // Twins: all factors 0.05 % off, one row 0.05 % off, a blocker that is not there.
  EXPECT_FALSE(furnace_holds(scaled(f.matrix, 1.0005F), 1e-4));
  FormFactorMatrix row = f.matrix;
  for (float& x : row.row(7)) x *= 0.9995F;
  EXPECT_FALSE(furnace_holds(row, 1e-4));
  EXPECT_FALSE(
      furnace_holds(test::with_a_ghost(b.mesh(), {{{0.4, 0.4, 0.4}, {0.6, 0.4, 0.4}, {0.4, 0.6, 0.4}}}), 1e-4));
}

/// The twins differ from the assembly in what is broken only: with sound rays its worker gives the assembly's own.
TEST(Exact, TheTwinsWorkerIsTheAssemblysOwn) {
  Builder b = parallel(1, 4);
  b.part("screen").plate({-3, -3, 0.5}, {3.5, 0, 0}, {0, 7, 0}, 1);
  const Vec3 far{1e3, 1e3, 1e3};
  const FormFactorMatrix twin = test::with_a_ghost(b.mesh(), {far, far + Vec3{1, 0, 0}, far + Vec3{0, 1, 0}});
  const GroupFactors own = b.factors(raw()), theirs = between(twin, b.mesh(), b.grouping());
  EXPECT_NEAR(own.factors[0][1], theirs.factors[0][1], 1e-5);
}

}  // namespace
}  // namespace interflect
