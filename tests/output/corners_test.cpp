#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include "interflect/base/error.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;

constexpr Rgb grey{0.5, 0.5, 0.5};

Rgb constant(double b) {
  return {b, 2 * b, 3 * b};
}

/// Every corner of the patches of a group has exactly this radiosity.
void expect_group(const Lit& lit, const std::string& group, const Rgb& expected) {
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  int seen = 0;
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    if (lit.solution.grouping.names[lit.solution.grouping.of_surface[lit.mesh.surface[i]]] != group) continue;
    ++seen;
    for (const Rgb& c : corners[i]) {
      for (std::size_t k = 0; k < 3; ++k) ASSERT_NEAR(c[k], expected[k], 1e-12) << group << " patch " << i;
    }
  }
  EXPECT_GT(seen, 0) << group;
}

void set_group(Lit& lit, const std::string& group, const Rgb& value) {
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    if (lit.solution.grouping.names[lit.solution.grouping.of_surface[lit.mesh.surface[i]]] == group) {
      lit.solution.radiosity[i] = value;
    }
  }
}

TEST(CornersTest, ReproduceALinearFieldInsideAFlatWall) {
  SceneBuilder s;
  s.quad("wall", s.material(grey), {0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0});
  Lit lit(s.scene(), 0.13);
  const auto field = [](Vec3 p) { return Rgb{1 + p.x, 5 - p.y, 2 + 0.5 * p.x + 0.25 * p.y}; };
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) lit.solution.radiosity[i] = field(lit.mesh.centroid[i]);
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  int inner = 0;
  double from_flat = 0;
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const auto points = lit.mesh.triangle(i);
    for (std::size_t c = 0; c < 3; ++c) {
      const Vec3 p = points[c];
      if (p.x < 0.01 || p.x > 3.99 || p.y < 0.01 || p.y > 3.99) continue;
      ++inner;
      for (std::size_t k = 0; k < 3; ++k) ASSERT_NEAR(corners[i][c][k], field(p)[k], 1e-12);
      from_flat = std::max(from_flat, std::abs(lit.solution.radiosity[i][0] - field(p)[0]));
    }
  }
  EXPECT_GT(inner, 100);
  // What patches of one colour would have given: far outside the bound above.
  EXPECT_GT(from_flat, 0.1);
}

TEST(CornersTest, DoNotMixAcrossAnEdgeBetweenWalls) {
  SceneBuilder s;
  const auto m = s.material(grey);
  s.quad("floor", m, {0, 0, 0}, {0, 0, 1}, {1, 0, 1}, {1, 0, 0});
  s.quad("wall", m, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  Lit lit(s.scene(), 0.01);
  set_group(lit, "floor", constant(1));
  set_group(lit, "wall", constant(5));
  expect_group(lit, "floor", constant(1));
  expect_group(lit, "wall", constant(5));
}

TEST(CornersTest, MixAcrossTheSeamOfOneSurfaceOnly) {
  for (const bool same : {true, false}) {
    SceneBuilder s;
    const auto left = s.material(grey), right = same ? left : s.material({0.5, 0.5, 0.6});
    s.quad("left", left, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
    s.quad("right", right, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0});
    Lit lit(s.scene(), 0.01);
    set_group(lit, "left", constant(1));
    set_group(lit, "right", constant(5));
    if (!same) {
      expect_group(lit, "left", constant(1));
      expect_group(lit, "right", constant(5));
      continue;
    }
    const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
    int seam = 0;
    for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        const Vec3 p = lit.mesh.triangle(i)[c];
        if (std::abs(p.x - 1) > 1e-9 || p.y < 0.01 || p.y > 0.99) continue;
        ++seam;
        EXPECT_NEAR(corners[i][c][0], 3, 1e-12);
      }
    }
    EXPECT_GT(seam, 10);
  }
}

TEST(CornersTest, LampsDoNotBleed) {
  SceneBuilder s;
  s.quad("ceiling", s.material(grey), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  s.quad("lamp", s.material(grey, {9, 9, 9}), {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0});
  Lit lit(s.scene(), 0.01);
  set_group(lit, "ceiling", constant(1));
  set_group(lit, "lamp", constant(100));
  expect_group(lit, "ceiling", constant(1));
  expect_group(lit, "lamp", constant(100));
}

TEST(CornersTest, SidesOfATwoSidedSheetDoNotMix) {
  SceneBuilder s;
  s.quad("sheet", s.material(grey, {}, true), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  Lit lit(s.scene(), 0.01);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    lit.solution.radiosity[i] = constant(lit.mesh.normal[i].z > 0 ? 1 : 7);
  }
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    for (const Rgb& c : corners[i]) EXPECT_NEAR(c[0], lit.solution.radiosity[i][0], 1e-12);
  }
}

/// An upright barrel without lids, one quad per side.
Scene barrel(int sides) {
  SceneBuilder s;
  const auto m = s.material(grey);
  const auto at = [&](int k, double y) {
    const double angle = 2 * std::numbers::pi * k / sides;
    return Vec3{std::cos(angle), y, -std::sin(angle)};
  };
  for (int k = 0; k < sides; ++k) s.quad("side", m, at(k, 0), at(k + 1, 0), at(k + 1, 1), at(k, 1));
  return s.scene();
}

TEST(CornersTest, SmoothAcrossARoundBarrelButNotASquareOne) {
  for (const int sides : {24, 4}) {
    Lit lit(barrel(sides), 0.05);
    for (std::size_t i = 0; i < lit.mesh.size(); ++i) lit.solution.radiosity[i] = constant(1 + lit.mesh.normal[i].x);
    const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
    std::map<std::uint32_t, std::pair<double, double>> range;  // per vertex: least and largest value of its corners
    for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        const double b = corners[i][c][0];
        auto [it, fresh] = range.try_emplace(lit.mesh.corners[i][c], b, b);
        it->second = {std::min(it->second.first, b), std::max(it->second.second, b)};
      }
    }
    double jump = 0;
    for (const auto& [v, r] : range) jump = std::max(jump, r.second - r.first);
    if (sides == 24) {
      EXPECT_EQ(jump, 0);
    } else {
      EXPECT_GT(jump, 0.9);
    }
  }
}

TEST(CornersTest, NoCrackBesideACoarserTriangle) {
  // Two triangles of one wall share an edge; the small one is cut less often, so vertices hang on its edge.
  SceneBuilder s;
  const auto surface = s.surface_of("wall", s.material(grey));
  s.triangle(surface, {0, 0, 0}, {8, 0, 0}, {0, 8, 0});
  s.triangle(surface, {0, 0, 0}, {0.6, -1, 0}, {8, 0, 0});
  Lit lit(s.scene(), 1.1);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const Vec3 p = lit.mesh.centroid[i];
    lit.solution.radiosity[i] = constant(1 + p.x * p.x + (p.y < 0 ? 3 : 0));
  }
  const SmoothMesh smooth = smooth_mesh(lit.mesh);
  ASSERT_GT(smooth.hanging.size(), 0U);
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  // The value along y = 0 as seen from either side.
  const auto along = [&](double x, bool above) {
    for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
      if ((lit.mesh.centroid[i].y > 0) != above) continue;
      const auto p = lit.mesh.triangle(i);
      for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t d = (c + 1) % 3;
        if (std::abs(p[c].y) > 1e-12 || std::abs(p[d].y) > 1e-12) continue;
        const double t = (x - p[c].x) / (p[d].x - p[c].x);
        if (t >= 0 && t <= 1) return (1 - t) * corners[i][c][0] + t * corners[i][d][0];
      }
    }
    ADD_FAILURE() << "no edge at " << x;
    return 0.0;
  };
  for (double x = 0.05; x < 8; x += 0.1) EXPECT_NEAR(along(x, true), along(x, false), 1e-9) << x;
}

TEST(CornersTest, LightDoesNotLeakUnderAWallThatStandsOnTheFloor) {
  for (const bool wall : {true, false}) {
    SceneBuilder s;
    const auto m = s.material(grey);
    s.quad("left", m, {0, 0, 0}, {0, 0, 1}, {1, 0, 1}, {1, 0, 0});
    s.quad("right", m, {1, 0, 0}, {1, 0, 1}, {2, 0, 1}, {2, 0, 0});
    if (wall) s.quad("wall", s.material(grey, {}, true), {1, 0, 0}, {1, 0, 1}, {1, 1, 1}, {1, 1, 0});
    Lit lit(s.scene(), 0.01);
    set_group(lit, "left", constant(1));
    set_group(lit, "right", constant(9));
    if (wall) {
      expect_group(lit, "left", constant(1));
      expect_group(lit, "right", constant(9));
    } else {
      const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
      double most = 0;
      for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
        if (lit.mesh.centroid[i].x > 1) continue;
        for (const Rgb& c : corners[i]) most = std::max(most, c[0]);
      }
      EXPECT_GT(most, 3);  // so it is the wall that keeps the light apart above
    }
  }
}

TEST(CornersTest, ManyPatchesAroundOneVertex) {
  constexpr int blades = 500;
  SceneBuilder s;
  const auto surface = s.surface_of("disc", s.material(grey));
  const auto at = [](int k) {
    const double angle = 2 * std::numbers::pi * k / blades;
    return Vec3{std::cos(angle), std::sin(angle), 0};
  };
  for (int k = 0; k < blades; ++k) s.triangle(surface, {0, 0, 0}, at(k), at(k + 1));
  Lit lit(s.scene(), 0);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) lit.solution.radiosity[i] = constant(i % 2 == 0 ? 1 : 3);
  for (const auto& corners : corner_radiosities(lit.mesh, lit.solution.radiosity)) {
    for (const Rgb& c : corners) EXPECT_NEAR(c[0], 2, 1e-6);
  }
}

TEST(CornersTest, PatchesWithoutAFiniteRadiosityAreLeftOut) {
  SceneBuilder s;
  s.quad("wall", s.material(grey), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  Lit lit(s.scene(), 0.1);
  set_group(lit, "wall", constant(2));
  lit.solution.radiosity[1][1] = std::numeric_limits<double>::quiet_NaN();
  lit.solution.radiosity[2][2] = std::numeric_limits<double>::infinity();
  for (const auto& corners : corner_radiosities(lit.mesh, lit.solution.radiosity)) {
    for (const Rgb& c : corners) {
      EXPECT_TRUE(c[0] == 2 || c[0] == 0) << c[0];
    }
  }
  for (Rgb& b : lit.solution.radiosity) b[0] = std::numeric_limits<double>::quiet_NaN();
  for (const auto& corners : corner_radiosities(lit.mesh, lit.solution.radiosity)) {
    for (const Rgb& c : corners) EXPECT_EQ(c, (Rgb{}));
  }
}

TEST(CornersTest, RefuseAWrongNumberOfRadiosities) {
  SceneBuilder s;
  s.quad("wall", s.material(grey), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  const Lit lit(s.scene(), 0);
  EXPECT_THROW((void)corner_radiosities(lit.mesh, {}), Error);
}

}  // namespace
}  // namespace interflect
