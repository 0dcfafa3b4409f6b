#include "interflect/output/charts.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numeric>

#include "output/rooms.h"
#include "output/sample_scene.h"

namespace interflect {
namespace {

using test::Lit;
using test::Sample;
using test::SceneBuilder;

constexpr Rgb grey{0.5, 0.5, 0.5};

/// Every patch is in one chart, lies in its rectangle, and is as large there as in space.
void expect_sound(const PatchMesh& mesh, const Charts& charts) {
  std::vector<int> times(mesh.size(), 0);
  for (std::uint32_t k = 0; k < charts.list.size(); ++k) {
    const Chart& chart = charts.list[k];
    EXPECT_GE(chart.width, chart.height);
    EXPECT_NEAR(dot(cross(chart.across, chart.down), mesh.normal[chart.patches.at(0)]), -1, 1e-3);
    for (const std::uint32_t i : chart.patches) {
      ++times.at(i);
      EXPECT_EQ(charts.of_patch.at(i), k);
      std::array<Vec2, 3> t{};
      for (std::size_t c = 0; c < 3; ++c) {
        t[c] = chart.place(mesh.triangle(i)[c]);
        const double slack = 1e-9 * chart.width;
        EXPECT_TRUE(t[c].x >= -slack && t[c].x <= chart.width + slack) << t[c].x;
        EXPECT_TRUE(t[c].y >= -slack && t[c].y <= chart.height + slack) << t[c].y;
      }
      const double twice = (t[1].x - t[0].x) * (t[2].y - t[0].y) - (t[1].y - t[0].y) * (t[2].x - t[0].x);
      EXPECT_LT(twice, 0);  // y points down: what runs counter-clockwise in space does so to the eye
      EXPECT_NEAR(-twice / 2 / mesh.area[i], 1, 4e-4);
    }
  }
  EXPECT_THAT(times, ::testing::Each(1));
}

TEST(ChartsTest, ABoxHasOnePerFace) {
  SceneBuilder s;
  const auto m = s.material(grey);
  s.box("box", {m, m, m, m, m, m}, {0, 0, 0}, {3, 1, 2}, true);
  const Lit lit(s.scene(), 0.05);
  const Charts charts = flat_charts(lit.mesh);
  expect_sound(lit.mesh, charts);
  std::vector<double> areas;
  for (const Chart& chart : charts.list) areas.push_back(chart.width * chart.height);
  EXPECT_THAT(areas, ::testing::UnorderedPointwise(::testing::DoubleNear(1e-9), {3., 3., 6., 6., 2., 2.}));
}

TEST(ChartsTest, ARoundBodyHasOnePerFacet) {
  const Sample lit;
  const Charts charts = flat_charts(lit.mesh);
  expect_sound(lit.mesh, charts);
  EXPECT_EQ(charts.list.size(), 3U + 16U);
}

TEST(ChartsTest, EachSideHasItsOwn) {
  SceneBuilder s;
  s.quad("sheet", s.material(grey, {}, true), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  const Lit lit(s.scene(), 0.01);
  const Charts charts = flat_charts(lit.mesh);
  expect_sound(lit.mesh, charts);
  ASSERT_EQ(charts.list.size(), 2U);
  EXPECT_EQ(charts.list[0].patches.size(), charts.list[1].patches.size());
}

TEST(ChartsTest, ATurnedQuadHasTheSmallestRectangle) {
  SceneBuilder s;
  const Vec3 x = normalized(Vec3{1, 2, 3}), y = normalized(cross(x, Vec3{0, 1, 0}));
  s.quad("turned", s.material(grey), {0, 0, 0}, x * 2, x * 2 + y * 0.5, y * 0.5);
  const Lit lit(s.scene(), 0.01);
  const Charts charts = flat_charts(lit.mesh);
  expect_sound(lit.mesh, charts);
  ASSERT_EQ(charts.list.size(), 1U);
  EXPECT_NEAR(charts.list[0].width, 2, 1e-9);
  EXPECT_NEAR(charts.list[0].height, 0.5, 1e-9);
}

/// Two triangles that share an edge, folded along it.
std::size_t charts_of_a_fold(double radians) {
  SceneBuilder s;
  const auto surface = s.surface_of("fold", s.material(grey));
  s.triangle(surface, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  s.triangle(surface, {0, 0, 0}, {0, 1, 0}, {-std::cos(radians), 0.5, std::sin(radians)});
  const Lit lit(s.scene(), 0.01);
  const Charts charts = flat_charts(lit.mesh);
  expect_sound(lit.mesh, charts);
  return charts.list.size();
}

TEST(ChartsTest, AFoldEndsAChartAndAWarpDoesNot) {
  EXPECT_EQ(charts_of_a_fold(0), 1U);
  EXPECT_EQ(charts_of_a_fold(0.004), 1U);
  EXPECT_EQ(charts_of_a_fold(0.03), 2U);
  EXPECT_EQ(charts_of_a_fold(std::numbers::pi / 2), 2U);
}

TEST(ChartsTest, TrianglesThatOverlapAreParted) {
  SceneBuilder s;
  const auto surface = s.surface_of("doubled", s.material(grey));
  s.triangle(surface, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  s.triangle(surface, {0, 0, 0}, {1, 0, 0}, {0.2, 2, 0});   // over the first, with an edge in common
  s.triangle(surface, {1, 0, 0}, {0, 0, 0}, {0.5, -1, 0});  // beside both
  const Lit lit(s.scene(), 0.02);
  const Charts charts = flat_charts(lit.mesh);
  expect_sound(lit.mesh, charts);
  ASSERT_EQ(charts.list.size(), 2U);
  EXPECT_GT(charts.list[0].patches.size(), charts.list[1].patches.size());  // the third is with the first
}

TEST(ChartsTest, OverlapIsMoreThanARim) {
  const Triangle2 a{{{0, 0}, {1, 0}, {0, 1}}};
  EXPECT_TRUE(overlap(a, a, 1e-9));
  EXPECT_TRUE(overlap(a, {{{0.1, 0.1}, {0.2, 0.1}, {0.1, 0.2}}}, 1e-9));  // within
  EXPECT_TRUE(overlap(a, {{{-1, 0.2}, {2, 0.2}, {-1, 0.3}}}, 1e-9));      // across, no corner in the other
  EXPECT_FALSE(overlap(a, {{{1, 0}, {1, 1}, {0, 1}}}, 1e-9));             // an edge in common
  EXPECT_FALSE(overlap(a, {{{0, 0}, {-1, 0}, {0, -1}}}, 1e-9));           // a corner
  EXPECT_FALSE(overlap(a, {{{0.5, 0.5}, {1, 0.5}, {0.5, 1}}}, 1e-9));     // a corner on an edge
  EXPECT_FALSE(overlap(a, {{{5, 5}, {6, 5}, {5, 6}}}, 1e-9));
  EXPECT_FALSE(overlap(a, {{{0.501, 0.501}, {1, 0.501}, {0.501, 1}}}, 1e-9));  // their boxes overlap
  EXPECT_TRUE(overlap(a, {{{0.49, 0.49}, {1, 0.5}, {0.5, 1}}}, 1e-9));
  EXPECT_FALSE(overlap(a, {{{0.49, 0.49}, {1, 0.5}, {0.5, 1}}}, 0.1));
}

TEST(ChartsTest, LayersKeepOverlapsApart) {
  const Triangle2 a{{{0, 0}, {1, 0}, {0, 1}}}, beside{{{1, 0}, {1, 1}, {0, 1}}};
  EXPECT_THAT(layers_without_overlap({a, beside, a, a, beside}, 1e-9), ::testing::ElementsAre(0, 0, 1, 2, 1));
}

}  // namespace
}  // namespace interflect
