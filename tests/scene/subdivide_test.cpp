#include <gmock/gmock.h>

#include <cmath>
#include <numeric>
#include <set>

#include "scene/build_scene.h"

namespace interflect {
namespace {

using ::testing::HasSubstr;
using testing::message_of;
using testing::SceneBuilder;

Scene right_triangle() {  // area 8
  return SceneBuilder().triangle({0, 0, 0}, {4, 0, 0}, {0, 4, 0}).scene;
}

PatchMesh cut(const Scene& scene, double divide) {
  SubdivideOptions options;
  options.divide = divide;
  return subdivide(scene, options);
}

void expect_no_collapsed_patch(const PatchMesh& mesh) {
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const auto& c = mesh.corners[i];
    EXPECT_TRUE(c[0] != c[1] && c[1] != c[2] && c[2] != c[0]) << i;
    EXPECT_GT(mesh.area[i], 0) << i;
  }
}

TEST(Subdivide, SplitsIntoFourUntilTheAreaIsSmallEnough) {
  // 8 -> 2 -> 0.5 -> 0.125: a patch may be as large as `divide`, not larger.
  const Scene scene = right_triangle();
  EXPECT_EQ(count_patches(scene, 0), 1u);
  EXPECT_EQ(count_patches(scene, 100), 1u);
  EXPECT_EQ(count_patches(scene, 8), 1u);
  EXPECT_EQ(count_patches(scene, 7.99), 4u);
  EXPECT_EQ(count_patches(scene, 2), 4u);
  EXPECT_EQ(count_patches(scene, 1), 16u);
  EXPECT_EQ(count_patches(scene, 0.5), 16u);
  EXPECT_EQ(count_patches(scene, 0.49), 64u);
  for (const double divide : {0.0, 8.0, 2.0, 1.0, 0.49}) {
    EXPECT_EQ(cut(scene, divide).size(), count_patches(scene, divide)) << divide;
  }
}

TEST(Subdivide, RoundingDoesNotDecideBetweenEqualTriangles) {
  SceneBuilder builder;
  for (int i = 0; i < 100; ++i) {
    const double a = 0.1 * i, c = std::cos(a), s = std::sin(a);
    builder.triangle({10.0 * i, 0, 0}, {10.0 * i + 0.3 * c, 0.3 * s, 0}, {10.0 * i - 0.7 * s, 0.7 * c, 0});
  }
  EXPECT_EQ(count_patches(builder.scene, 0.105 / 4), 400u);
}

TEST(Subdivide, AreaAndNormalArePreserved) {
  const Scene scene = SceneBuilder().triangle({1, 2, 3}, {4, 2.5, 1}, {-2, 7, 0.5}).cube().scene;
  const PatchMesh mesh = cut(scene, 0.01);
  std::vector<double> area(scene.triangles.size());
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const std::uint32_t t = mesh.source[i];
    area[t] += mesh.area[i];
    EXPECT_LE(mesh.area[i], 0.01 * (1 + 1e-8));
    const auto [a, b, c] = mesh.triangle(i);
    const Vec3 normal = normalized(cross(b - a, c - a));
    const auto& v = scene.triangles[t].vertex;
    const Vec3 whole =
        normalized(cross(scene.positions[v[1]] - scene.positions[v[0]], scene.positions[v[2]] - scene.positions[v[0]]));
    EXPECT_LT(length(normal - whole), 1e-12);
    EXPECT_LT(length(mesh.normal[i] - whole), 1e-15);
    EXPECT_LT(length(mesh.centroid[i] - (a + b + c) / 3), 1e-14);
    EXPECT_NEAR(0.5 * length(cross(b - a, c - a)), mesh.area[i], 1e-15);
  }
  for (std::size_t t = 0; t < area.size(); ++t) EXPECT_NEAR(area[t], scene.area(scene.triangles[t]), 1e-12) << t;
}

TEST(Subdivide, OrderIsHierarchical) {
  const PatchMesh mesh = cut(right_triangle(), 0.05);  // depth 4
  ASSERT_EQ(mesh.size(), 256u);
  EXPECT_TRUE(std::is_sorted(mesh.source.begin(), mesh.source.end()));
  // Each aligned block of 4^k patches fills one triangle of the hierarchy: its extent is halved with each level, and
  // patches next to each other in index share a corner within a block of four.
  double edge = 4;
  for (std::size_t block = 256; block >= 1; block /= 4, edge /= 2) {
    for (std::size_t first = 0; first < mesh.size(); first += block) {
      Vec3 low{9, 9, 9}, high{-9, -9, -9};
      for (std::size_t i = first; i < first + block; ++i) {
        for (const Vec3 p : mesh.triangle(i)) {
          low = min(low, p);
          high = max(high, p);
        }
      }
      EXPECT_DOUBLE_EQ((high - low).x, edge) << block << " " << first;
      EXPECT_DOUBLE_EQ((high - low).y, edge) << block << " " << first;
    }
  }
  for (std::size_t i = 0; i + 1 < mesh.size(); ++i) {
    if (i % 4 == 3) continue;
    const auto &a = mesh.corners[i], &b = mesh.corners[i + 1];
    EXPECT_NE(std::find_first_of(a.begin(), a.end(), b.begin(), b.end()), a.end()) << i;
  }
}

TEST(Subdivide, NeighboursShareVertices) {
  // Both halves of a square with corners of their own, as STL-like files have them; depth 3 gives a grid of 9 x 9.
  const Scene exact = SceneBuilder().quad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}).scene;
  EXPECT_EQ(cut(exact, 0.6 / 64).vertices.size(), 81u);
  Scene rounded = exact;
  rounded.positions[3] = {1e-8, -1e-8, 1e-8};
  rounded.positions[4] = {1, 1 + 1e-8, 0};
  EXPECT_EQ(cut(rounded, 0.6 / 64).vertices.size(), 81u);
  Scene apart = exact;
  apart.positions[3].z = 1e-4;
  EXPECT_GT(cut(apart, 0.6 / 64).vertices.size(), 81u);
}

TEST(Subdivide, NeighboursOfDifferentDepthShareTheVerticesThatBothHave) {
  // A long edge beside two short ones: its midpoint is their common corner.
  const Scene scene =
      SceneBuilder().triangle({0, 0, 0}, {2, 0, 0}, {1, 2, 0}).triangle({1, 0, 0}, {0, 0, 0}, {0.5, -0.5, 0}).scene;
  const PatchMesh mesh = cut(scene, 0.6);  // 2 -> 0.5, and 0.25 as it is
  ASSERT_EQ(mesh.size(), 5u);
  EXPECT_EQ(mesh.vertices.size(), 7u);
}

TEST(Subdivide, WeldingCollapsesNoPatch) {
  // Patches much smaller than 1e-6 of the scene's diagonal.
  SceneBuilder builder;
  builder.quad({0, 0, 0}, {1e6, 0, 0}, {1e6, 1e6, 0}, {0, 1e6, 0});
  builder.quad({0, 0, 5}, {1e-3, 0, 5}, {1e-3, 1e-3, 5}, {0, 1e-3, 5});
  builder.triangle({7, 7, 7}, {8, 7, 7}, {7.5, 7 + 1e-6, 7});  // a sliver
  for (const double divide : {0.0, 1e8, 1e9}) {
    const PatchMesh mesh = cut(builder.scene, divide);
    expect_no_collapsed_patch(mesh);
    EXPECT_NEAR(std::accumulate(mesh.area.begin(), mesh.area.end(), 0.0), 1e12 + 1e-6 + 5e-7, 1e-3);
  }
  const PatchMesh mesh = cut(builder.scene, 0);
  EXPECT_NEAR(mesh.area[2] + mesh.area[3], 1e-6, 1e-9);
}

TEST(Subdivide, TwoSidedTrianglesGiveFrontsThenBacks) {
  Scene scene = SceneBuilder().triangle({0, 0, 0}, {4, 0, 0}, {0, 4, 0}).scene;
  scene.materials[0].two_sided = true;
  EXPECT_EQ(count_patches(scene, 2), 8u);
  const PatchMesh mesh = cut(scene, 2);
  ASSERT_EQ(mesh.size(), 8u);
  EXPECT_EQ(mesh.vertices.size(), 6u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(mesh.normal[i], (Vec3{0, 0, 1}));
    EXPECT_EQ(mesh.normal[i + 4], (Vec3{0, 0, -1}));
    EXPECT_EQ(mesh.centroid[i], mesh.centroid[i + 4]);
    EXPECT_EQ(std::set(mesh.corners[i].begin(), mesh.corners[i].end()),
              std::set(mesh.corners[i + 4].begin(), mesh.corners[i + 4].end()));
    const auto [a, b, c] = mesh.triangle(i + 4);
    EXPECT_LT(cross(b - a, c - a).z, 0);
    EXPECT_EQ(mesh.source[i + 4], 0u);
    EXPECT_EQ(mesh.reflectance[i + 4], mesh.reflectance[i]);
  }

  scene.materials[0].two_sided = false;
  SubdivideOptions options;
  options.two_sided = true;
  EXPECT_EQ(subdivide(scene, options).size(), 2u);
  EXPECT_EQ(count_patches(scene, 0, true), 2u);
}

TEST(Subdivide, DegenerateTrianglesAreLeftOut) {
  SceneBuilder builder;
  builder.triangle({0, 0, 0}, {1, 1, 1}, {2, 2, 2});        // on a line
  builder.triangle({0, 0, 0}, {0, 0, 0}, {1, 0, 0});        // a repeated corner
  builder.triangle({0, 0, 0}, {1, 0, 0}, {0.5, 1e-13, 0});  // no area to rounding
  EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)cut(builder.scene, 1); }), HasSubstr("built.obj"));
  message_of(ErrorKind::input, [&] { (void)choose_divide(builder.scene, 10); });
  builder.triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  const PatchMesh mesh = cut(builder.scene, 1);
  ASSERT_EQ(mesh.size(), 1u);
  EXPECT_EQ(mesh.source[0], 3u);
  EXPECT_EQ(mesh.vertices.size(), 3u);
}

TEST(Subdivide, ChooseDivideComesNearest) {
  // Areas 8 and 1.
  const Scene scene =
      SceneBuilder().triangle({0, 0, 0}, {4, 0, 0}, {0, 4, 0}).triangle({0, 0, 1}, {2, 0, 1}, {0, 1, 1}).scene;
  // divide: 8 -> 1 + 1; 2 -> 4 + 1; 1 -> 16 + 1; 0.5 -> 16 + 4; 0.25 -> 64 + 4
  const std::vector<std::pair<std::uint64_t, std::uint64_t>> nearest{
      {1, 2}, {2, 2}, {3, 2}, {4, 5}, {5, 5}, {11, 5}, {12, 17}, {18, 17}, {19, 20}, {44, 20}, {45, 68}, {68, 68}};
  for (const auto& [wanted, got] : nearest) {
    EXPECT_EQ(count_patches(scene, choose_divide(scene, wanted)), got) << wanted;
    SubdivideOptions options;
    options.patches = wanted;
    EXPECT_EQ(subdivide(scene, options).size(), got) << wanted;
  }
  EXPECT_EQ(count_patches(scene, choose_divide(scene, 10, true), true), 10u);
  // A tie takes the smaller count: with one triangle, 4 and 16 are as far from 10.
  EXPECT_EQ(count_patches(right_triangle(), choose_divide(right_triangle(), 10)), 4u);
}

TEST(Subdivide, TooManyPatchesAreRefusedWithASuggestion) {
  SubdivideOptions options;
  options.divide = 1e-300;
  EXPECT_THAT(message_of(ErrorKind::limit, [&] { (void)subdivide(right_triangle(), options); }), HasSubstr("--divide"));
  options.divide = 0.1;  // 256
  options.max_patches = 100;
  const std::string message = message_of(ErrorKind::limit, [&] { (void)subdivide(right_triangle(), options); });
  EXPECT_THAT(message, HasSubstr("256 patches"));
  const double suggested = std::stod(message.substr(message.find("--divide ") + 9));
  EXPECT_EQ(count_patches(right_triangle(), suggested), 64u);
  options.max_patches = 256;
  EXPECT_EQ(subdivide(right_triangle(), options).size(), 256u);
  options = {};
  options.max_patches = 11;
  EXPECT_THAT(message_of(ErrorKind::limit, [&] { (void)subdivide(SceneBuilder().cube().scene, options); }),
              HasSubstr("12 patches before any division"));
  // The count itself does not overflow.
  const Scene vast = SceneBuilder().triangle({0, 0, 0}, {1e70, 0, 0}, {0, 1e70, 0}).scene;
  EXPECT_EQ(count_patches(vast, 1e-300), std::numeric_limits<std::uint64_t>::max());
}

TEST(Subdivide, AreasThatAreNoAreasAreRefused) {
  for (const double divide : {-1.0, std::nan(""), HUGE_VAL}) {
    message_of(ErrorKind::usage, [&] { (void)cut(right_triangle(), divide); });
    message_of(ErrorKind::usage, [&] { (void)count_patches(right_triangle(), divide); });
  }
}

TEST(Subdivide, ScenesThatAreNotSoundAreRefused) {
  const auto refuse = [](ErrorKind kind, const auto& damage) {
    Scene scene = right_triangle();
    damage(scene);
    message_of(kind, [&] { (void)cut(scene, 1); });
  };
  refuse(ErrorKind::usage, [](Scene& s) { s.triangles[0].vertex[2] = 3; });
  refuse(ErrorKind::usage, [](Scene& s) { s.triangles[0].surface = 1; });
  refuse(ErrorKind::usage, [](Scene& s) { s.triangles[0].uv = 0; });
  refuse(ErrorKind::usage, [](Scene& s) { s.surfaces[0].material = 1; });
  refuse(ErrorKind::usage, [](Scene& s) { s.positions[1].y = std::nan(""); });
  refuse(ErrorKind::input, [](Scene& s) { s.positions[1].x = 1e300; });
}

TEST(Subdivide, TexturesAreAveragedOverEachPatch) {
  // Red rises from 0 in the left half to 1 in the right half; green is 1 in the upper half.
  Scene scene = SceneBuilder().quad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}).scene;
  scene.images.push_back({2, 2, {0, 1, 0.25F, 1, 1, 0.25F, 0, 0, 0.25F, 1, 0, 0.25F}});
  scene.uvs = {{0, 1}, {1, 1}, {1, 0}, {0, 1}, {1, 0}, {0, 0}};
  scene.triangles[0].uv = 0;
  scene.triangles[1].uv = 3;
  scene.materials[0].reflectance = {1, 0.5, 1};
  scene.materials[0].reflectance_image = 0;
  // The whole lower right triangle: 3/4 of it lie in the right half, 1/4 in the upper one.
  const PatchMesh whole = cut(scene, 0);
  ASSERT_EQ(whole.size(), 2u);
  EXPECT_NEAR(whole.reflectance[0][0], 0.75, 0.02);
  EXPECT_NEAR(whole.reflectance[0][1], 0.5 * 0.25, 0.02);
  EXPECT_NEAR(whole.reflectance[0][2], 0.25, 1e-6);
  EXPECT_EQ(whole.emittance[0], (Rgb{1, 1, 1}));
  // Small patches lie in one texel each.
  const PatchMesh fine = cut(scene, 0.5 / 4);
  for (std::size_t i = 0; i < fine.size(); ++i) {
    const Vec3 c = fine.centroid[i];
    if (std::abs(c.x - 0.5) > 0.2 && std::abs(c.y - 0.5) > 0.2) {
      EXPECT_NEAR(fine.reflectance[i][0], c.x > 0.5 ? 1 : 0, 1e-12) << i;
      EXPECT_NEAR(fine.reflectance[i][1], c.y > 0.5 ? 0.5 : 0, 1e-12) << i;
    }
  }
}

}  // namespace
}  // namespace interflect
