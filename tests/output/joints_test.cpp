#include "interflect/output/joints.h"

#include <gmock/gmock.h>

#include "output/sample_scene.h"

namespace interflect {
namespace {

using test::Lit;
using test::Sample;
using test::SceneBuilder;
using Triangles = std::vector<std::array<Vec3, 3>>;

/// Pairs of an edge of a triangle and a corner of another that lies within it.
std::size_t gaps(const Triangles& triangles) {
  std::size_t found = 0;
  for (const auto& t : triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 a = t[k], along = t[(k + 1) % 3] - a;
      for (const auto& other : triangles) {
        for (const Vec3 p : other) {
          const double share = dot(p - a, along) / dot(along, along);
          found += share > 1e-6 && share < 1 - 1e-6 && length(p - a - along * share) < 1e-6;
        }
      }
    }
  }
  return found;
}

Triangles whole(const PatchMesh& mesh) {
  Triangles out;
  for (std::size_t i = 0; i < mesh.size(); ++i) out.push_back(mesh.triangle(i));
  return out;
}

/// As the cutter has them; each patch's fill it, with its winding.
Triangles cut(const PatchMesh& mesh) {
  const JointCutter cutter(mesh);
  Triangles out;
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    double area = 0;
    for (const auto& t : cutter.cut(i)) {
      const auto at = [&](std::size_t k) {
        const Joint& joint = t[k];
        const Vec3 p = mesh.vertices[joint.vertex];
        const auto corners = mesh.triangle(i);
        const Vec3 q = corners[joint.ends[0]] * (1 - joint.share) + corners[joint.ends[1]] * joint.share;
        EXPECT_LT(length(p - q), 1e-6);  // it lies where it says
        return p;
      };
      out.push_back({at(0), at(1), at(2)});
      const auto& o = out.back();
      const double signed_area = dot(cross(o[1] - o[0], o[2] - o[0]), mesh.normal[i]) / 2;
      EXPECT_GT(signed_area, 1e-9);
      area += signed_area;
    }
    EXPECT_NEAR(area / mesh.area[i], 1, 1e-6);
  }
  return out;
}

TEST(JointsTest, NoVertexIsLeftOnAnEdge) {
  const Sample lit;
  EXPECT_GT(gaps(whole(lit.mesh)), 10U);  // walls and floor are cut to different sizes
  const Triangles triangles = cut(lit.mesh);
  EXPECT_GT(triangles.size(), lit.mesh.size());
  EXPECT_EQ(gaps(triangles), 0U);
}

TEST(JointsTest, APatchWithFinerNeighboursOnAllSidesIsFilled) {
  SceneBuilder s;
  const auto m = s.material({0.5, 0.5, 0.5});
  const auto coarse = s.surface_of("coarse", m), fine = s.surface_of("fine", m);
  s.triangle(coarse, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});  // area 0.5; the neighbours' are larger and cut further
  s.triangle(fine, {1, 0, 0}, {0, 0, 0}, {0, -8, 0});
  s.triangle(fine, {0, 1, 0}, {1, 0, 0}, {8, 8, 0});
  s.triangle(fine, {0, 0, 0}, {0, 1, 0}, {-8, 0, 0});
  const Lit lit(s.scene(), 0.6);
  EXPECT_GT(gaps(whole(lit.mesh)), 3U);
  EXPECT_EQ(gaps(cut(lit.mesh)), 0U);
  EXPECT_GT(JointCutter(lit.mesh).cut(0).size(), 3U);
}

TEST(JointsTest, WhereAllFitNothingIsCut) {
  SceneBuilder s;
  const auto m = s.material({0.5, 0.5, 0.5});
  s.box("box", {m, m, m, m, m, m}, {0, 0, 0}, {1, 1, 1}, true);
  const Lit lit(s.scene(), 0.01);
  EXPECT_EQ(cut(lit.mesh).size(), lit.mesh.size());
}

}  // namespace
}  // namespace interflect
