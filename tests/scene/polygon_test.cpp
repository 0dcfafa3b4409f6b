#include "interflect/scene/polygon.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "scene/build_scene.h"

namespace interflect {
namespace {

using testing::message_of;

Vec3 area_vector(Vec3 a, Vec3 b, Vec3 c) {
  return 0.5 * cross(b - a, c - a);
}

/// Expects n - 2 triangles, wound like the outline, that fill the outline's area without an overlap.
void expect_proper(const std::vector<Vec3>& corners, double area) {
  const Triangulation cut = triangulate(corners);
  EXPECT_TRUE(cut.simple);
  EXPECT_EQ(cut.triangles.size(), corners.size() - 2);
  Vec3 whole{};
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) whole += area_vector(corners[0], corners[i], corners[i + 1]);
  double sum = 0;
  for (const auto& t : cut.triangles) {
    const Vec3 part = area_vector(corners[t[0]], corners[t[1]], corners[t[2]]);
    EXPECT_GE(dot(part, whole), 0);
    sum += length(part);
  }
  // No triangle is turned and the areas add up to the outline's own: they cannot overlap.
  EXPECT_NEAR(sum, area, 1e-12 * area);
  EXPECT_NEAR(length(whole), area, 1e-12 * area);
}

TEST(Triangulate, ConvexOutlinesMakeAFan) {
  std::vector<Vec3> circle;
  for (int i = 0; i < 12; ++i) {
    const double a = i * std::numbers::pi / 6;
    circle.push_back({std::cos(a), 2, -std::sin(a)});
  }
  expect_proper(circle, 3);
  const Triangulation cut = triangulate(circle);
  for (std::uint32_t i = 0; i < 10; ++i) EXPECT_EQ(cut.triangles[i], (std::array<std::uint32_t, 3>{0, i + 1, i + 2}));
}

TEST(Triangulate, ConcaveOutlinesInAnyDirection) {
  // An L of area 3, from each of its corners, in each of three planes and with either winding.
  const std::vector<Vec2> shape{{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
  for (std::size_t start = 0; start < shape.size(); ++start) {
    std::vector<Vec3> xy, yz, zx;
    for (std::size_t i = 0; i < shape.size(); ++i) {
      const Vec2 p = shape[(start + i) % shape.size()];
      xy.push_back({p.x, p.y, 5});
      yz.push_back({-3, p.x, p.y});
      zx.push_back({p.y, p.x, p.x + p.y});
    }
    expect_proper(xy, 3);
    expect_proper(yz, 3);
    expect_proper(zx, 3 * std::sqrt(3.0));
    std::reverse(xy.begin(), xy.end());
    expect_proper(xy, 3);
  }
}

TEST(Triangulate, CombsAndSpirals) {
  std::vector<Vec3> comb;  // 50 teeth, each of area 1/2
  for (int i = 0; i < 50; ++i) {
    comb.push_back({double(i), 0, 0});
    comb.push_back({i + 0.5, 1, 0});
  }
  comb.push_back({50, 0, 0});
  comb.push_back({50, -1, 0});
  comb.push_back({0, -1, 0});
  expect_proper(comb, 25 + 50);

  std::vector<Vec3> spiral;
  for (int i = 0; i <= 200; ++i) {
    const double a = 0.1 * i;
    spiral.push_back({(1 + a) * std::cos(a), (1 + a) * std::sin(a), 0});
  }
  for (int i = 200; i >= 0; --i) {
    const double a = 0.1 * i;
    spiral.push_back({(1.5 + a) * std::cos(a), (1.5 + a) * std::sin(a), 0});
  }
  double area = 0;
  for (std::size_t i = 0; i < spiral.size(); ++i) {
    const Vec3 p = spiral[i], q = spiral[(i + 1) % spiral.size()];
    area += 0.5 * (p.x * q.y - p.y * q.x);
  }
  expect_proper(spiral, std::abs(area));
}

TEST(Triangulate, CornersOnAnEdgeAndAHoleByABridge) {
  expect_proper({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}}, 4);
  for (const auto& t :
       triangulate(std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}}).triangles) {
    EXPECT_NE(t, (std::array<std::uint32_t, 3>{0, 1, 2})) << "a triangle without area leaves a gap";
  }
  // A square ring: out along one bridge and back.
  expect_proper(
      {{0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0}, {0, 0, 0}, {1, 1, 0}, {1, 3, 0}, {3, 3, 0}, {3, 1, 0}, {1, 1, 0}},
      12);
}

TEST(Triangulate, OutlinesWithoutSenseStillEnd) {
  const auto count = [](const std::vector<Vec3>& corners) { return triangulate(corners).triangles.size(); };
  EXPECT_EQ(count({{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}}), 2u);               // a bow tie
  EXPECT_EQ(count({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}}), 3u);    // a line
  EXPECT_EQ(count(std::vector<Vec3>(7)), 5u);                                       // a point
  EXPECT_EQ(count({{0, 0, 0}, {1e308, 0, 0}, {-1e308, 1e308, 0}, {0, 1, 1}}), 2u);  // overflow
  std::vector<Vec3> star;
  for (int i = 0; i < 101; ++i) star.push_back({std::cos(i * 2.8), std::sin(i * 2.8), 0});
  EXPECT_EQ(count(star), 99u);
  EXPECT_FALSE(triangulate(std::vector<Vec3>(7)).simple);
}

TEST(Triangulate, HugeOutlines) {
  std::vector<Vec3> circle;
  constexpr int n = 100000;
  for (int i = 0; i < n; ++i) {
    circle.push_back({1e3 * std::cos(i * 2 * std::numbers::pi / n), 1e3 * std::sin(i * 2 * std::numbers::pi / n), 0});
  }
  EXPECT_EQ(triangulate(circle).triangles.size(), n - 2u);
  circle[1] = {0, 0, 0};
  circle[n / 2] = {0, 1, 0};
  EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)triangulate(circle); }), ::testing::HasSubstr("100000"));
}

}  // namespace
}  // namespace interflect
