#include <gmock/gmock.h>

#include <cmath>
#include <utility>

#include "scene/build_scene.h"

namespace interflect {
namespace {

using ::testing::HasSubstr;
using testing::SceneBuilder;

/// The finding whose text holds `what`, or one with count 0.
Finding finding(const Scene& scene, const std::string& what, bool two_sided = false) {
  for (const Finding& f : check_scene(scene, two_sided)) {
    if (f.what.find(what) != std::string::npos) return f;
  }
  return {};
}

TEST(CheckScene, AClosedCubeThatEmitsIsFaultless) {
  const Scene scene = SceneBuilder().cube().scene;
  for (const Finding& f : check_scene(scene)) ADD_FAILURE() << f.line();
}

TEST(CheckScene, DegenerateTriangles) {
  SceneBuilder builder;
  builder.cube().triangle({0, 0, 0}, {1, 1, 1}, {2, 2, 2});
  const Finding f = finding(builder.scene, "degenerate");
  EXPECT_EQ(f.count, 1u);
  EXPECT_EQ(f.severity, Finding::Severity::warning);
  EXPECT_EQ(f.line(), "degenerate triangles (dropped): 1, first: line 13 (object 'thing', group 'part')");
  EXPECT_EQ(finding(SceneBuilder().triangle({0, 0, 0}, {1, 0, 0}, {0, 1e-5, 0}).scene, "degenerate").count, 0u);
}

TEST(CheckScene, DuplicateTriangles) {
  SceneBuilder builder;
  builder.cube();
  const auto corners = [&](std::size_t t) {
    const auto& v = builder.scene.triangles[t].vertex;
    return std::array{builder.scene.positions[v[0]], builder.scene.positions[v[1]], builder.scene.positions[v[2]]};
  };
  const auto [a, b, c] = corners(4);
  builder.triangle(a, c, b);  // back to back: another surface
  EXPECT_EQ(finding(builder.scene, "duplicate").count, 0u);
  builder.triangle(b, c, a).triangle(c, a, b + Vec3{1e-9, 0, 0});  // rotated, and a little off
  const Finding f = finding(builder.scene, "duplicate");
  EXPECT_EQ(f.count, 2u);
  EXPECT_EQ(f.severity, Finding::Severity::warning);
  ASSERT_EQ(f.first.size(), 2u);
  EXPECT_THAT(f.first[0], ::testing::StartsWith("line 14 "));
  EXPECT_THAT(f.first[0], HasSubstr("repeats line 5"));
}

TEST(CheckScene, NormalsThatDisagreeInAClosedPiece) {
  Scene scene = SceneBuilder().cube().scene;
  std::swap(scene.triangles[3].vertex[1], scene.triangles[3].vertex[2]);
  Finding f = finding(scene, "normal");
  EXPECT_EQ(f.count, 1u);
  ASSERT_EQ(f.first.size(), 1u);
  EXPECT_THAT(f.first[0], HasSubstr("line 4"));
  EXPECT_EQ(finding(scene, "normal", true).count, 0u) << "both sides are the same when it is two-sided";
  scene.materials[0].two_sided = true;
  EXPECT_EQ(finding(scene, "normal").count, 0u);

  // All of them turned: an inside as good as an outside.
  scene = SceneBuilder().cube().scene;
  for (Triangle& t : scene.triangles) std::swap(t.vertex[1], t.vertex[2]);
  EXPECT_EQ(finding(scene, "normal").count, 0u);

  // An open piece: nobody can say.
  scene.triangles.pop_back();
  std::swap(scene.triangles[3].vertex[1], scene.triangles[3].vertex[2]);
  EXPECT_EQ(finding(scene, "normal").count, 0u);

  // A closed piece beside an open one.
  SceneBuilder two;
  two.cube().triangle({5, 5, 5}, {6, 5, 5}, {5, 6, 5});
  std::swap(two.scene.triangles[0].vertex[1], two.scene.triangles[0].vertex[2]);
  EXPECT_EQ(finding(two.scene, "normal").count, 1u);
}

TEST(CheckScene, ReflectanceOutsideTheUnitInterval) {
  const double nan = std::nan("");
  for (const Rgb& bad : {Rgb{0.5, 1.01, 0.5}, Rgb{-0.1, 0, 0}, Rgb{0, 0, nan}}) {
    Scene scene = SceneBuilder().cube().scene;
    scene.materials[0].reflectance = bad;
    const Finding f = finding(scene, "reflectance");
    EXPECT_EQ(f.count, 1u);
    EXPECT_EQ(f.severity, Finding::Severity::error);
    EXPECT_THAT(f.line(), HasSubstr("'grey'"));
    EXPECT_THAT(f.line(), HasSubstr("line 1 (object 'thing'"));
  }
  Scene scene = SceneBuilder().cube().scene;
  scene.materials[0].reflectance = {0, 1, 0.5};
  scene.materials.push_back({.name = "unused", .reflectance = {2, 2, 2}});
  EXPECT_EQ(finding(scene, "reflectance").count, 0u);
}

TEST(CheckScene, EmittanceMustBeFiniteAndNotNegative) {
  for (const double bad : {-1.0, std::nan(""), HUGE_VAL}) {
    Scene scene = SceneBuilder().cube().scene;
    scene.materials[0].emittance = {1, bad, 1};
    const Finding f = finding(scene, "non-finite emittance");
    EXPECT_EQ(f.count, 1u) << bad;
    EXPECT_EQ(f.severity, Finding::Severity::error);
  }
  EXPECT_EQ(finding(SceneBuilder().cube().scene, "emittance").count, 0u);
}

TEST(CheckScene, NoEmitter) {
  Scene scene = SceneBuilder().cube().scene;
  EXPECT_EQ(finding(scene, "emits").count, 0u);
  scene.materials[0].emittance = {0, 0, 0};
  EXPECT_EQ(finding(scene, "emits").count, 1u);
  EXPECT_EQ(finding(scene, "emits").severity, Finding::Severity::warning);
  scene.materials.push_back({.name = "unused lamp", .emittance = {9, 9, 9}});
  EXPECT_EQ(finding(scene, "emits").count, 1u);
}

TEST(CheckScene, OpenEdges) {
  Scene scene = SceneBuilder().cube().scene;
  EXPECT_EQ(finding(scene, "open edges").count, 0u);
  scene.triangles.pop_back();
  EXPECT_EQ(finding(scene, "open edges").count, 3u);
  EXPECT_EQ(finding(scene, "open edges").severity, Finding::Severity::warning);
  EXPECT_EQ(finding(SceneBuilder().quad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}).scene, "open edges").count, 4u);
}

TEST(CheckScene, FindingsStayOnOneLine) {
  Scene scene = SceneBuilder().triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0}).scene;
  scene.surfaces[0].object = "two\nlines\x1b[31m";
  for (const Finding& f : check_scene(scene)) {
    for (const char c : f.line()) EXPECT_GE(static_cast<unsigned char>(c), 0x20) << f.line();
  }
}

TEST(CheckScene, AnUnsoundSceneIsAFinding) {
  Scene scene = SceneBuilder().cube().scene;
  scene.triangles[2].vertex[0] = 9999;
  const auto findings = check_scene(scene);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].severity, Finding::Severity::error);
  EXPECT_EQ(check_scene(Scene{}).size(), 1u) << "an empty scene has no emitter";
}

}  // namespace
}  // namespace interflect
