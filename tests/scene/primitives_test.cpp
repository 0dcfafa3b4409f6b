#include "interflect/scene/primitives.h"

#include <gtest/gtest.h>

#include <map>
#include <numbers>
#include <set>
#include <string>

#include "interflect/base/error.h"

namespace interflect {
namespace {

Vec3 scaled_normal(const SurfaceMesh& mesh, const std::array<std::uint32_t, 3>& t) {
  const Vec3 a = mesh.positions[t[0]];
  return cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a) * 0.5;
}

double total_area(const SurfaceMesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) sum += length(scaled_normal(mesh, t));
  return sum;
}

double volume(const SurfaceMesh& mesh) {  // divergence theorem
  double sum = 0;
  for (const auto& t : mesh.triangles) sum += dot(mesh.positions[t[0]], scaled_normal(mesh, t)) / 3;
  return sum;
}

using Edge = std::pair<std::uint32_t, std::uint32_t>;

/// How often each directed edge is run through.
std::map<Edge, int> directed_edges(const SurfaceMesh& mesh) {
  std::map<Edge, int> count;
  for (const auto& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) ++count[{t[i], t[(i + 1) % 3]}];
  }
  return count;
}

void expect_distinct_positions(const SurfaceMesh& mesh) {
  std::set<std::array<double, 3>> seen;
  for (const Vec3 p : mesh.positions) EXPECT_TRUE(seen.insert({p.x, p.y, p.z}).second);
}

void expect_closed(const SurfaceMesh& mesh) {
  expect_distinct_positions(mesh);
  const auto edges = directed_edges(mesh);
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 1) << edge.first << "-" << edge.second;
    EXPECT_TRUE(edges.contains({edge.second, edge.first})) << edge.first << "-" << edge.second;
  }
}

void expect_no_degenerate(const SurfaceMesh& mesh) {
  for (const auto& t : mesh.triangles) EXPECT_GT(length(scaled_normal(mesh, t)), 1e-7);
}

struct Case {
  Primitive primitive;
  int division;
};

class Solid : public ::testing::TestWithParam<Case> {};

TEST_P(Solid, IsClosedAndItsNormalsPointOutwards) {
  const SurfaceMesh mesh = make_primitive(GetParam().primitive, GetParam().division);
  EXPECT_EQ(mesh.triangles.size(), primitive_triangles(GetParam().primitive, GetParam().division));
  expect_closed(mesh);
  expect_no_degenerate(mesh);
  for (const auto& t : mesh.triangles) {  // convex and around the origin
    EXPECT_GT(dot(scaled_normal(mesh, t), mesh.positions[t[0]] + mesh.positions[t[1]] + mesh.positions[t[2]]), 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Primitives, Solid,
                         ::testing::Values(Case{Primitive::cuboid, 1}, Case{Primitive::cuboid, 3},
                                           Case{Primitive::cuboid, 10}, Case{Primitive::barrel, 3},
                                           Case{Primitive::barrel, 20}, Case{Primitive::barrel, 101},
                                           Case{Primitive::globe, 3}, Case{Primitive::globe, 5},
                                           Case{Primitive::globe, 20}, Case{Primitive::globe, 37}));

TEST(Primitives, RrvsTriangleCounts) {
  EXPECT_EQ(primitive_triangles(Primitive::cuboid, division_range(Primitive::cuboid).usual), 12u);
  EXPECT_EQ(primitive_triangles(Primitive::barrel, division_range(Primitive::barrel).usual), 80u);
  EXPECT_EQ(primitive_triangles(Primitive::globe, division_range(Primitive::globe).usual), 360u);
}

TEST(Primitives, CuboidIsTheUnitCube) {
  for (const int n : {1, 2, 7}) {
    const SurfaceMesh mesh = make_primitive(Primitive::cuboid, n);
    EXPECT_NEAR(total_area(mesh), 6, 1e-12);
    EXPECT_NEAR(volume(mesh), 1, 1e-12);
    for (const Vec3 p : mesh.positions) EXPECT_EQ(std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}), 0.5);
  }
}

TEST(Primitives, BarrelIsThePrismInscribedInTheCylinder) {
  const double pi = std::numbers::pi;
  for (const int n : {3, 20, 400}) {
    const SurfaceMesh mesh = make_primitive(Primitive::barrel, n);
    const double prism = n * (0.25 * std::sin(2 * pi / n) + std::sin(pi / n));
    EXPECT_NEAR(total_area(mesh), prism, 1e-12);
    EXPECT_NEAR(volume(mesh), 0.125 * n * std::sin(2 * pi / n), 1e-12);
    // sin x >= x - x³/6: the prism is smaller than the cylinder (3π/2) by at most π³/n² (1/3 + 1/6).
    EXPECT_LT(total_area(mesh), 1.5 * pi);
    EXPECT_GT(total_area(mesh), 1.5 * pi - pi * pi * pi / (2.0 * n * n));
  }
}

TEST(Primitives, GlobeIsInscribedInTheSphere) {
  const double pi = std::numbers::pi;
  for (const int n : {8, 20, 200}) {
    const SurfaceMesh mesh = make_primitive(Primitive::globe, n);
    for (const Vec3 p : mesh.positions) EXPECT_NEAR(length(p), 0.5, 1e-15);
    // No point of a face lies deeper than its sagitta: both steps are 2π/n, so it is inside by at most the factor
    // cos²(π/n); the mesh encloses the sphere shrunk by it, and a convex body has the larger surface.
    const double shrink = std::cos(pi / n) * std::cos(pi / n);
    EXPECT_LT(total_area(mesh), pi);
    EXPECT_GT(total_area(mesh), pi * shrink * shrink);
    EXPECT_GT(volume(mesh), pi / 6 * shrink * shrink * shrink);
  }
}

TEST(Primitives, OutOfRangeDivisionIsRefused) {
  for (const Primitive p : {Primitive::cuboid, Primitive::barrel, Primitive::globe, Primitive::teapot}) {
    EXPECT_THROW((void)make_primitive(p, division_range(p).least - 1), Error);
    EXPECT_THROW((void)make_primitive(p, division_range(p).most + 1), Error);
    EXPECT_NO_THROW((void)make_primitive(p, division_range(p).least));
  }
}

TEST(Teapot, FillsNewellsBoundingBox) {
  const SurfaceMesh mesh = make_teapot(64);
  Vec3 low = mesh.positions[0], high = low;
  for (const Vec3 p : mesh.positions) {
    low = min(low, p);
    high = max(high, p);
  }
  EXPECT_EQ(low, (Vec3{-3, 0, -2}));
  EXPECT_EQ(high.y, 3.15);
  EXPECT_EQ(high.z, 2);
  EXPECT_NEAR(high.x, 3.434, 2e-3);  // inside the lip's curve: not at a sample
  EXPECT_LT(high.x, 3.4342);
}

TEST(Teapot, HasThirtyTwoPatches) {
  // 4 quarters of 6 profiles and 2 halves of 4 tubes; 8 of them end in a pole, where n triangles collapse.
  for (const int n : {1, 2, 5, 8}) {
    const auto per_patch = static_cast<std::uint64_t>(2 * n * n);
    EXPECT_EQ(make_teapot(n).triangles.size(), 32 * per_patch - 8 * static_cast<std::uint64_t>(n));
    EXPECT_EQ(primitive_triangles(Primitive::teapot, n), make_teapot(n).triangles.size());
  }
}

TEST(Teapot, IsWatertightBetweenPatches) {
  constexpr int n = 8;
  const SurfaceMesh mesh = make_teapot(n);
  expect_distinct_positions(mesh);
  expect_no_degenerate(mesh);
  const auto edges = directed_edges(mesh);
  std::map<std::string, int> border;
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 1);
    if (edges.contains({edge.second, edge.first})) continue;
    const Vec3 a = mesh.positions[edge.first], b = mesh.positions[edge.second];
    const double r = std::hypot(a.x, a.z);
    const bool level = a.y == b.y && a.y == 2.4;
    if (level && a.x > 2.5) {
      ++border["spout's mouth"];
    } else if (level) {
      EXPECT_NEAR(r, r < 1.35 ? 1.3 : 1.4, 6e-3);  // Newell's circle bulges by 0.4 %
      ++border[r < 1.35 ? "lid" : "rim"];
    } else if (a.x == 1.7 && b.x == 1.7) {
      ++border["spout's root"];
    } else {
      EXPECT_LT(a.x, -1.4);
      EXPECT_GT(a.x, -2.01);
      ++border[a.y > 1.5 ? "handle's upper root" : "handle's lower root"];
    }
  }
  const std::map<std::string, int> expected{{"rim", 4 * n},
                                            {"lid", 4 * n},
                                            {"spout's mouth", 2 * n},
                                            {"spout's root", 2 * n},
                                            {"handle's upper root", 2 * n},
                                            {"handle's lower root", 2 * n}};
  EXPECT_EQ(border, expected);
}

/// The parts that hang together by edges, as lists of triangles. (By a vertex the handle hangs on the body.)
std::vector<std::vector<std::size_t>> components(const SurfaceMesh& mesh) {
  std::vector<std::size_t> root(mesh.triangles.size());
  const auto find = [&](std::size_t i) {
    while (root[i] != i) i = root[i] = root[root[i]];
    return i;
  };
  std::map<Edge, std::size_t> first;
  for (std::size_t i = 0; i < root.size(); ++i) {
    root[i] = i;
    const auto& t = mesh.triangles[i];
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [other, added] = first.try_emplace(std::minmax(t[k], t[(k + 1) % 3]), i);
      if (!added) root[find(i)] = find(other->second);
    }
  }
  std::map<std::size_t, std::vector<std::size_t>> parts;
  for (std::size_t i = 0; i < root.size(); ++i) parts[find(i)].push_back(i);
  std::vector<std::vector<std::size_t>> list;
  for (auto& [key, triangles] : parts) list.push_back(std::move(triangles));
  return list;
}

TEST(Teapot, NormalsPointOutwards) {
  const SurfaceMesh mesh = make_teapot(8);
  const auto parts = components(mesh);
  ASSERT_EQ(parts.size(), 4u);  // body with rim and bottom, lid, handle, spout
  for (const auto& part : parts) {
    // Winding is consistent within a part (each edge is run through once in each direction), so one face decides: of
    // the faces at the part's outermost point to either side, the normal looks that way.
    for (const double side : {-1.0, 1.0}) {
      std::size_t best = part[0];
      double reach = -1e9;
      for (const std::size_t i : part) {
        const auto& t = mesh.triangles[i];
        const double z = side * (mesh.positions[t[0]].z + mesh.positions[t[1]].z + mesh.positions[t[2]].z);
        if (z > reach) {
          reach = z;
          best = i;
        }
      }
      EXPECT_GT(side * scaled_normal(mesh, mesh.triangles[best]).z, 0);
    }
  }
}

TEST(Teapot, VolumeConverges) {
  // Refining by two quarters the error of a smooth surface.
  const double v8 = volume(make_teapot(8)), v16 = volume(make_teapot(16)), v32 = volume(make_teapot(32));
  EXPECT_GT(v8, 0);
  EXPECT_NEAR((v16 - v8) / (v32 - v16), 4, 0.4);
}

}  // namespace
}  // namespace interflect
