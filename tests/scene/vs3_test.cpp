#include <gmock/gmock.h>

#include "scene/build_scene.h"

namespace interflect {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::TestFolder;

const std::string square = "V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\n";

/// A square of the plane z = 0 from (low, low) to (high, high), as four vertices from `first`.
std::string vertices(int first, const std::string& low, const std::string& high) {
  const auto v = [&](int k, const std::string& x, const std::string& y) {
    return "V " + std::to_string(first + k) + " " + x + " " + y + " 0\n";
  };
  return v(0, low, low) + v(1, high, low) + v(2, high, high) + v(3, low, high);
}

Scene read(const std::string& text) {
  return read_vs3(text, "a.vs3");
}

/// Area and summed normals of the triangles of one object.
struct Part {
  double area = 0;
  Vec3 normals{};
};
Part part(const Scene& scene, const std::string& object, bool obstruction = false) {
  Part out;
  for (const Triangle& t : scene.triangles) {
    const Surface& surface = scene.surfaces[t.surface];
    if (surface.object != object || surface.obstruction != obstruction) continue;
    const Vec3 a = scene.positions[t.vertex[0]];
    out.area += scene.area(t);
    out.normals += 0.5 * cross(scene.positions[t.vertex[1]] - a, scene.positions[t.vertex[2]] - a);
  }
  return out;
}

const Material& material_of(const Scene& scene, const std::string& object) {
  for (const Surface& s : scene.surfaces) {
    if (s.object == object) return scene.materials[s.material];
  }
  throw Error(ErrorKind::internal, "no such object");
}

TEST(Vs3, ReadsVerticesSurfacesAndComments) {
  const Scene scene = read(
      "! a comment\n/ another one\nt  A title ! with S 1 in it\nC encl=0 list = 2, out=1\nf 3\n  V 1, 0., .0 0\nv\t2 "
      "1. 0 0e0"
      " ! here\nV 3 1 +1 0.0 left over\nV 4\n 0\n\n! between\n1 0.\nS 1 1 2 3 4 0 0 0.25 floor ! not this\nS 2 1 3 2 0 "
      "0 0 "
      "1.0 three 77\nEnd of data\nS 3 nonsense\n");
  EXPECT_THAT(scene.warnings, IsEmpty());
  EXPECT_EQ(scene.name, "a");
  ASSERT_EQ(scene.triangles.size(), 3u);
  EXPECT_EQ(scene.triangles[0].line, 14u);
  EXPECT_EQ(scene.triangles[2].line, 15u);
  EXPECT_DOUBLE_EQ(part(scene, "floor").area, 1);
  EXPECT_EQ(part(scene, "floor").normals, (Vec3{0, 0, 1})) << "counter-clockwise seen from the front";
  EXPECT_EQ(part(scene, "three").normals, (Vec3{0, 0, -0.5}));
  EXPECT_DOUBLE_EQ(material_of(scene, "floor").reflectance[1], 0.75);
  EXPECT_DOUBLE_EQ(material_of(scene, "floor").emittance[2], 0.25);
  EXPECT_DOUBLE_EQ(material_of(scene, "three").reflectance[0], 0);
}

TEST(Vs3, AStarEndsTheDataAsWell) {
  const Scene scene = read(square + "S 1 1 2 3 4 0 0 .5 a\n* S 2 x\nS 2 y\n");
  EXPECT_EQ(scene.surfaces.size(), 1u);
}

/// The normals of the cube of View3D's manual look inward: its volume, seen from outside, is -1.
TEST(Vs3, TheRightHandRulesNormalLooksIntoTheRoom) {
  const std::string cube =
      square +
      "V 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\nS 1 1 2 3 4 0 0 .5 zeq0\nS 2 1 4 8 5 0 0 .5 xeq0\n"
      "S 3 1 5 6 2 0 0 .5 yeq0\nS 4 7 6 5 8 0 0 .5 zeq1\nS 5 7 3 2 6 0 0 .5 xeq1\n"
      "S 6 7 8 4 3 0 0 .5 yeq1\n";
  const Scene scene = read(cube);
  double volume = 0;
  for (const Triangle& t : scene.triangles) {
    volume += dot(scene.positions[t.vertex[0]], cross(scene.positions[t.vertex[1]], scene.positions[t.vertex[2]])) / 6;
  }
  EXPECT_DOUBLE_EQ(volume, -1);
  EXPECT_EQ(part(scene, "xeq0").normals, (Vec3{1, 0, 0}));
  EXPECT_EQ(part(scene, "zeq1").normals, (Vec3{0, 0, -1}));
  EXPECT_THAT(group_surfaces(scene).names, ElementsAre("zeq0", "xeq0", "yeq0", "zeq1", "xeq1", "yeq1"));
  for (const Finding& finding : check_scene(scene)) ADD_FAILURE() << finding.line();
}

/// Origin, azimuth (clockwise from +y) and tilt of format 3a: a wall that faces north, one that faces east, a floor, a
/// ceiling; rectangle, quadrilateral, triangle.
TEST(Vs3, ShapesInAPlane) {
  const Scene scene = read(
      "F 3A\nS 1 R 0 0 .9 north\n 3. 0. 0.   0 90   3. 2.\nS 2 r 0 0 .9 east ignored words\n0 0 0 90 90\n\n 3 2\n"
      "S 3 Q 0 0 .9 floor\n0 0 1 180 0\n 0 0 1 0 1 1\n0 1\nS 4 T 0 0 .9 ceiling\n0 0 4 0 180 0 0 1 0 0 2\nE\n");
  EXPECT_NEAR(length(part(scene, "north").normals - Vec3{0, 6, 0}), 0, 1e-14);
  EXPECT_NEAR(length(part(scene, "east").normals - Vec3{6, 0, 0}), 0, 1e-14);
  EXPECT_NEAR(length(part(scene, "floor").normals - Vec3{0, 0, 1}), 0, 1e-14);
  EXPECT_NEAR(length(part(scene, "ceiling").normals - Vec3{0, 0, -1}), 0, 1e-14);
  // the wall that faces north spans x from 3 down to 0, seen from its front from left to right
  EXPECT_NEAR(scene.positions[1].x, 3, 1e-14);
  EXPECT_NEAR(scene.positions[2].x, 0, 1e-14);
  EXPECT_NEAR(scene.positions[0].z, 2, 1e-14);
}

TEST(Vs3, CombinedSurfacesAreOneGroupAtTheFirstOnesPlace) {
  const Scene scene =
      read(square +
           "S 1 1 2 3 0 0 0 .5 a\nS 2 1 3 4 0 0 0 .5 b\nS 3 1 2 4 0 0 1 .7 a2\nS 4 1 2 3 0 0 0 .5 a\nS 5 "
           "1 2 3 0 0 0 .5\n");
  EXPECT_THAT(group_surfaces(scene).names, ElementsAre("a", "b", "a#4", "surface#5"));
  EXPECT_THAT(group_surfaces(scene, GroupBy::object).names, ElementsAre("a", "b", "a2", "a#4", "surface#5"));
  ASSERT_EQ(scene.warnings.size(), 1u);
  EXPECT_THAT(scene.warnings[0], HasSubstr("a.vs3:8: another surface is called 'a': this one becomes 'a#4'"));
  EXPECT_DOUBLE_EQ(material_of(scene, "a2").reflectance[0], 1 - 0.7) << "each keeps its own emittance";
}

TEST(Vs3, WhatLiesOnABaseIsCutOutOfIt) {
  const std::string text = square + vertices(5, ".2", ".8") + vertices(9, ".4", ".6") +
                           "S 1 1 2 3 4 0 0 .5 wall\nS 2 5 6 7 8 1 0 .5 window\n";
  const Scene two = read(text);
  EXPECT_NEAR(part(two, "wall").area, 0.64, 1e-15);
  EXPECT_NEAR(part(two, "wall").normals.z, 0.64, 1e-15) << "all pieces face as the wall does";
  EXPECT_NEAR(part(two, "window").area, 0.36, 1e-15);
  const Scene three = read(text + "S 3 9 10 11 12 2 0 .5 pane\n");
  EXPECT_NEAR(part(three, "wall").area, 0.64, 1e-15);
  EXPECT_NEAR(part(three, "window").area, 0.32, 1e-15);
  EXPECT_NEAR(part(three, "pane").area, 0.04, 1e-15);
}

TEST(Vs3, ABaseMayBeCoveredWholly) {
  const Scene scene = read(square + "S 1 1 2 3 4 0 0 .5 wall\nS 2 1 2 3 4 1 0 .5 paint\n");
  EXPECT_EQ(part(scene, "wall").area, 0);
  EXPECT_EQ(part(scene, "paint").area, 1);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("a.vs3:5: nothing of surface 1 is left")));
  EXPECT_THAT(group_surfaces(scene).names, ElementsAre("wall", "paint")) << "the rows of View3D's table stay";
}

TEST(Vs3, NullSurfacesLeaveAHoleAndMasksAreWarnedOf) {
  const std::string text = square + vertices(5, ".2", ".8") + "S 1 1 2 3 4 0 0 .5 wall\n";
  const Scene null = read(text + "N 2 8 7 6 5 1 0 .5 hole\n");
  EXPECT_NEAR(part(null, "wall").area, 0.64, 1e-15);
  EXPECT_THAT(group_surfaces(null).names, ElementsAre(HasSubstr("emittance"))) << "one group is left";
  EXPECT_EQ(null.surfaces.size(), 1u);
  EXPECT_THAT(null.warnings, IsEmpty());
  const Scene mask = read(text + "m 2 8 7 6 5 1 0 .5 cover\n");
  EXPECT_NEAR(part(mask, "wall").area, 0.64, 1e-15);
  EXPECT_THAT(mask.warnings, ElementsAre(HasSubstr("a.vs3:10: a mask and what it covers")));
}

TEST(Vs3, ObstructionsAreAGroupApartWithAPatchOnEachSide) {
  const Scene scene =
      read(square + vertices(5, ".2", ".8") +
           "S 1 4 3 2 1 0 0 .5 obstruction\nS 2 5 6 7 8 4 0 .3 lamp\nS 3 1 2 3 0 0 0 .5 c\nO 4 1 2 3 4 0 0 "
           "0.5 x\nO 5 1 2 3 0\n");
  const Grouping grouping = group_surfaces(scene);
  EXPECT_THAT(grouping.names, ElementsAre("obstruction", "lamp", "obstruction", "c"));
  EXPECT_THAT(grouping.obstruction, ElementsAre(false, false, true, false));
  EXPECT_NEAR(part(scene, "obstruction#4", true).area, 0.64, 1e-15) << "without the lamp on it";
  EXPECT_NEAR(part(scene, "lamp", false).normals.z, 0.36, 1e-15);
  EXPECT_NEAR(part(scene, "lamp", true).normals.z, -0.36, 1e-15) << "the obstruction's other side behind the lamp";
  EXPECT_TRUE(material_of(scene, "obstruction#4").two_sided);
  EXPECT_EQ(material_of(scene, "obstruction#4").reflectance, (Rgb{0, 0, 0}));
  EXPECT_EQ(material_of(scene, "obstruction#4").emittance, (Rgb{0, 0, 0}));
  EXPECT_FALSE(material_of(scene, "lamp").two_sided);
  EXPECT_THAT(scene.warnings, IsEmpty());
}

TEST(Vs3, CornersOffAPlaneAreWarnedOf) {
  const auto bent = [](const char* z) {
    return read(std::string("V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 ") + z + "\nV 4 0 1 0\nS 1 1 2 3 4 0 0 .5 a\n");
  };
  EXPECT_THAT(bent("0.001").warnings, ElementsAre(HasSubstr("a.vs3:5: the corners of surface 1 lie up to")));
  EXPECT_EQ(bent("0.001").triangles.size(), 2u);
  EXPECT_THAT(bent("0.000001").warnings, IsEmpty());
}

TEST(Vs3, ControlWordsThatWouldChangeTheAnswerAreNamed) {
  const auto warnings = [](const std::string& control) {
    return read(control + "\n" + square + "S 1 1 2 3 4 0 0 .5 a\n").warnings;
  };
  EXPECT_THAT(warnings("C list=3 out=1 encl=0 emit=0 row=0 col=0 maxV=20"), IsEmpty());
  EXPECT_THAT(warnings("C"), IsEmpty());
  EXPECT_THAT(warnings("c ENCL = 1"), ElementsAre(HasSubstr("encl=1")));
  EXPECT_THAT(warnings("C emit=1 row=2,col=3"), ElementsAre(HasSubstr("emit=1"), HasSubstr("row and col")));
  EXPECT_THAT(warnings("C eps=1.e-5 maxU=8 mino=0"), ElementsAre(HasSubstr("eps, maxu, mino")));
  EXPECT_THAT(warnings("C depth=3"), ElementsAre(HasSubstr("not known: depth")));
}

TEST(Vs3, UnknownRecordsAreCounted) {
  const Scene scene = read("X 1 2 3\nG 3\ng 3\n" + square + "S 1 1 2 3 4 0 0 .5 a\n");
  EXPECT_THAT(scene.warnings,
              ElementsAre(HasSubstr("'G' records are ignored: 2"), HasSubstr("'X' records are ignored: 1")));
}

TEST(Vs3, IsChosenByTheExtension) {
  const TestFolder folder;
  const auto path = folder.file("Plates.VS3", square + "S 1 1 2 3 4 0 0 .5 a\r\nEND\r\n");
  const Scene scene = read_scene(path);
  EXPECT_EQ(scene.name, "Plates");
  EXPECT_EQ(scene.surfaces[0].object, "a");
  EXPECT_THAT(scene.files, ElementsAre(path));
}

}  // namespace
}  // namespace interflect
