#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <string>

#include "interflect/base/error.h"
#include "interflect/scene/scene.h"

namespace interflect {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

Scene read(const std::string& text) {
  return read_rrv_xml(text, "folder/room.xml");
}

/// A scene whose object "o" holds `inside`, instanced by `body`.
std::string document(const std::string& inside, const std::string& body = "<object name='o'/>") {
  return "<scene><head><objectdef name='o'>" + inside + "</objectdef></head><body>" + body + "</body></scene>";
}

const std::string one_triangle =
    "<triangleset><triangle><vertex x='0' y='0' z='0'/><vertex x='1' y='0' z='0'/><vertex x='0' y='1' z='0'/>"
    "</triangle></triangleset>";

/// The error's message; the test fails when there is none or it is not an input error naming the file.
std::string message_of(const std::string& text) {
  try {
    (void)read(text);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_THAT(error.what(), StartsWith("folder/room.xml:"));
    return error.what();
  }
  ADD_FAILURE() << "no error for " << text.substr(0, 200);
  return {};
}

std::array<Vec3, 3> corners(const Scene& scene, std::size_t t) {
  const auto& v = scene.triangles.at(t).vertex;
  return {scene.positions.at(v[0]), scene.positions.at(v[1]), scene.positions.at(v[2])};
}

Vec3 normal(const Scene& scene, std::size_t t) {
  const auto [a, b, c] = corners(scene, t);
  return normalized(cross(b - a, c - a));
}

void expect_near(Vec3 a, Vec3 b, double tolerance = 1e-15) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

std::pair<Vec3, Vec3> bounds(const Scene& scene) {
  std::pair<Vec3, Vec3> box{scene.positions.at(0), scene.positions.at(0)};
  for (const Vec3 p : scene.positions) box = {min(box.first, p), max(box.second, p)};
  return box;
}

TEST(RrvXml, StripWindsEveryOtherTriangleTheOtherWay) {
  std::string strip =
      "<triangleset name='band'>\n<triangle><vertex x='0' y='0' z='0'/><vertex x='0' y='-1' z='0'/>"
      "<vertex x='1' y='0' z='0'/></triangle>\n";
  for (int i = 1; i < 5; ++i) {
    strip += fmt::format("<trianglenext><vertex x='{}' y='{}' z='0'/></trianglenext>\n", (i + 1) / 2 + (i + 1) % 2,
                         -(i % 2));
  }
  // Vertices zigzag along x: 0,0  0,-1  1,0  1,-1  2,0  2,-1  3,0; all triangles face +z.
  const Scene scene = read(document(strip + "</triangleset>"));
  ASSERT_EQ(scene.triangles.size(), 5u);
  for (std::size_t t = 0; t < 5; ++t) {
    EXPECT_EQ(normal(scene, t), (Vec3{0, 0, 1})) << t;
    EXPECT_DOUBLE_EQ(scene.area(scene.triangles[t]), 0.5) << t;
    EXPECT_EQ(scene.triangles[t].line, t + 2);
  }
  EXPECT_EQ(scene.positions.size(), 7u);
  EXPECT_EQ(scene.surfaces.at(0).group, "band");
  EXPECT_EQ(scene.surfaces.at(0).object, "o");
}

TEST(RrvXml, NewTriangleStartsTheStripAnew) {
  const std::string triangle =
      "<triangle><vertex x='0' y='0' z='0'/><vertex x='1' y='0' z='0'/><vertex x='0' y='1' z='0'/></triangle>";
  const std::string next = "<trianglenext><vertex x='1' y='1' z='0'/></trianglenext>";
  const Scene scene = read(document("<triangleset>" + triangle + next + triangle + next + "</triangleset>"));
  ASSERT_EQ(scene.triangles.size(), 4u);
  for (std::size_t t = 0; t < 4; ++t) EXPECT_EQ(normal(scene, t), (Vec3{0, 0, 1})) << t;
}

TEST(RrvXml, ColoursAreInherited) {
  const std::string v3 = "<vertex x='0' y='0' z='0'/><vertex x='1' y='0' z='0'/><vertex x='0' y='1' z='0'/>";
  const std::string v1 = "<vertex x='1' y='1' z='0'/>";
  const Scene scene =
      read(document("<triangleset reflectivity='.1, .2 ,.3' emission='1,2,3' radiosity='9,9,9'>"
                    "<triangle>" +
                    v3 +
                    "</triangle>"  // the set's
                    "<triangle reflectivity='.5,.5,.5'>" +
                    v3 +
                    "</triangle>"  // its own reflectivity
                    "<trianglenext>" +
                    v1 +
                    "</trianglenext>"  // that of the triangle before
                    "<trianglenext emission='0,0,0'>" +
                    v1 +
                    "</trianglenext>"  // its own emission
                    "<triangle>" +
                    v3 +
                    "</triangle></triangleset>"
                    "<triangleset><triangle>" +
                    v3 + "</triangle></triangleset>"));  // black
  const auto material = [&](std::size_t t) {
    return scene.materials.at(scene.surfaces.at(scene.triangles.at(t).surface).material);
  };
  ASSERT_EQ(scene.triangles.size(), 6u);
  EXPECT_EQ(material(0).reflectance, (Rgb{.1, .2, .3}));
  EXPECT_EQ(material(0).emittance, (Rgb{1, 2, 3}));
  EXPECT_EQ(material(1).reflectance, (Rgb{.5, .5, .5}));
  EXPECT_EQ(material(1).emittance, (Rgb{1, 2, 3}));
  EXPECT_EQ(material(2).reflectance, (Rgb{.5, .5, .5}));
  EXPECT_EQ(material(2).emittance, (Rgb{1, 2, 3}));
  EXPECT_EQ(material(3).reflectance, (Rgb{.5, .5, .5}));
  EXPECT_EQ(material(3).emittance, (Rgb{0, 0, 0}));
  EXPECT_EQ(material(4).reflectance, (Rgb{.1, .2, .3}));
  EXPECT_EQ(material(5).reflectance, (Rgb{0, 0, 0}));
  EXPECT_EQ(material(5).emittance, (Rgb{0, 0, 0}));
  EXPECT_EQ(scene.materials.size(), 4u);
  EXPECT_FALSE(material(0).two_sided);
}

TEST(RrvXml, TransformsNestFromTheInside) {
  // A unit cube, scaled to 2 x 4 x 6, turned about z by 90° (x to y), moved.
  const Scene scene = read(document("<cuboid/>",
                                    "<translate dx='10' dy='20' dz='30'><rotate angle='90' dz='1'>"
                                    "<scale dx='2' dy='4' dz='6'><object name='o'/></scale></rotate></translate>"));
  EXPECT_EQ(bounds(scene), (std::pair{Vec3{8, 19, 27}, Vec3{12, 21, 33}}));
  ASSERT_EQ(scene.triangles.size(), 12u);
  for (std::size_t t = 0; t < 12; ++t) {
    const auto [a, b, c] = corners(scene, t);
    EXPECT_GT(dot(normal(scene, t), a - Vec3{10, 20, 30}), 0) << t;
  }
}

TEST(RrvXml, RotatesAsRrvDoes) {
  // rrv turns right-handed about x and z but left-handed about y, which its scenes count on.
  const auto turned = [](const std::string& attributes) {
    const Scene scene = read(document(one_triangle, "<rotate " + attributes + "><object name='o'/></rotate>"));
    const auto [a, b, c] = corners(scene, 0);
    return std::pair{b, c};  // where the x and y axes go
  };
  EXPECT_EQ(turned("angle='90' dx='1'"), (std::pair{Vec3{1, 0, 0}, Vec3{0, 0, 1}}));
  EXPECT_EQ(turned("angle='90' dy='2'"), (std::pair{Vec3{0, 0, 1}, Vec3{0, 1, 0}}));
  EXPECT_EQ(turned("angle='90' dz='1'"), (std::pair{Vec3{0, 1, 0}, Vec3{-1, 0, 0}}));
  EXPECT_EQ(turned("angle='-90' dz='1'"), turned("angle='90' dz='-3'"));
  EXPECT_EQ(turned("angle='0'"), (std::pair{Vec3{1, 0, 0}, Vec3{0, 1, 0}}));
  // About several axes it shares the angle out: here 30° about z, then 30° about x.
  const auto [x, y] = turned(fmt::format("angle='{}' dx='1' dz='1'", 30 * std::numbers::sqrt2));
  const double s = 0.5, c = std::numbers::sqrt3 / 2;
  expect_near(x, {c, s * c, s * s}, 1e-14);
  expect_near(y, {-s, c * c, c * s}, 1e-14);
}

TEST(RrvXml, MirrorKeepsTheFrontOutside) {
  for (const char* scale : {"dx='-1' dy='1' dz='1'", "dx='-1' dy='-2' dz='-3'"}) {
    const Scene scene = read(document("<globe/>", fmt::format("<scale {}><object name='o'/></scale>", scale)));
    for (std::size_t t = 0; t < scene.triangles.size(); ++t) {
      const auto [a, b, c] = corners(scene, t);
      EXPECT_GT(dot(normal(scene, t), a + b + c), 0);
    }
  }
}

TEST(RrvXml, ObjectsNestAndNameTheirPath) {
  const std::string text =
      "<scene><head>"
      "<objectdef name='table'><translate dx='1'><object name='leg'/></translate>"
      "<translate dx='-1'><object name='leg'/></translate><cuboid name='top'/></objectdef>"
      "<objectdef name='leg'><cuboid name='wood'/></objectdef></head>"
      "<body><object name='table'/><translate dy='5'><object name='leg'/></translate></body></scene>";
  const Scene scene = read(text);
  ASSERT_EQ(scene.triangles.size(), 48u);
  std::vector<std::string> objects, groups;
  for (const Surface& s : scene.surfaces) {
    objects.push_back(s.object);
    groups.push_back(s.group);
  }
  EXPECT_THAT(objects, ElementsAre("table/leg", "table", "leg"));
  EXPECT_THAT(groups, ElementsAre("wood", "top", "wood"));
  EXPECT_EQ(bounds(scene), (std::pair{Vec3{-1.5, -0.5, -0.5}, Vec3{1.5, 5.5, 0.5}}));
}

TEST(RrvXml, ShapesHaveRrvsSizesAndTakeADivision) {
  const auto count = [](const std::string& shape) { return read(document(shape)).triangles.size(); };
  EXPECT_EQ(count("<cuboid/>"), 12u);
  EXPECT_EQ(count("<barrel/>"), 80u);
  EXPECT_EQ(count("<globe/>"), 360u);
  EXPECT_EQ(count("<teapot/>"), 4032u);
  EXPECT_EQ(count("<cuboid division='3'/>"), 108u);
  EXPECT_EQ(count("<barrel division='6'/>"), 24u);
  EXPECT_EQ(count("<globe division='4'/>"), 8u);
  EXPECT_EQ(count("<teapot division='1'/>"), 56u);
  for (const char* shape : {"<cuboid/>", "<barrel/>", "<globe/>"}) {
    const auto [low, high] = bounds(read(document(shape)));
    EXPECT_EQ(low, (Vec3{-.5, -.5, -.5})) << shape;
    EXPECT_EQ(high, (Vec3{.5, .5, .5})) << shape;
  }
  EXPECT_EQ(read(document("<globe emission='1,2,3' reflectivity='.4,.5,.6'/>")).materials.at(0).emittance,
            (Rgb{1, 2, 3}));
}

TEST(RrvXml, ShapesMayStandInTheBody) {
  EXPECT_EQ(read("<scene><body><cuboid/></body></scene>").triangles.size(), 12u);
}

TEST(RrvXml, Camera) {
  const std::string body = "<body><cuboid/></body></scene>";
  EXPECT_FALSE(read("<scene>" + body).camera.has_value());
  const auto camera = read("<scene><camera eye='1,2,3' target='4,5,6' up='0,0,1' fov='60'/>" + body).camera;
  ASSERT_TRUE(camera.has_value());
  EXPECT_EQ(camera->eye, (Vec3{1, 2, 3}));
  EXPECT_EQ(camera->target, (Vec3{4, 5, 6}));
  EXPECT_EQ(camera->up, (Vec3{0, 0, 1}));
  EXPECT_DOUBLE_EQ(camera->vertical_fov, std::numbers::pi / 3);
  const auto plain = read("<scene><camera eye='1,2,3' target='4,5,6'/>" + body).camera;
  EXPECT_EQ(plain->up, Camera{}.up);
  EXPECT_DOUBLE_EQ(plain->vertical_fov, Camera{}.vertical_fov);
  EXPECT_THAT(message_of("<scene>\n<camera eye='1,2,3'/>" + body), HasSubstr(":2: <camera> needs"));
  EXPECT_THAT(message_of("<scene><camera eye='1,2,3' target='1,2,3'/>" + body), HasSubstr("coincide"));
  EXPECT_THAT(message_of("<scene><camera eye='0,0,0' target='0,1,0'/>" + body), HasSubstr("along 'up'"));
  EXPECT_THAT(message_of("<scene><camera eye='0,0,0' target='1,0,0' fov='180'/>" + body), HasSubstr("fov"));
}

TEST(RrvXml, ReadsWhatRrvWrites) {
  const Scene scene = read(
      "\xEF\xBB\xBF<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<!DOCTYPE scene SYSTEM "
      "\"http://dudka.cz/dtd/scene.dtd\">\n"
      "<scene>\n<head>\n<objectdef name=\"scene\">\n<triangleset name=\"first\">\n"
      "<triangle emission=\"0,0,0\" reflectivity=\"0.9,0.9,0.9\" radiosity=\"0.1,0.1,0.1\" spec=\"1\" refl=\"0\" "
      "refr=\"0\">\n"
      "<vertex x=\"1e1\" y=\"-10\" z=\"+10\"/><vertex x=\"10\" y=\"10\" z=\"10\"/><vertex x=\"10\" y=\"-10\" "
      "z=\"-10\"/>\n"
      "</triangle></triangleset></objectdef></head><!-- end --><body><object name=\"scene\"/></body></scene>\n");
  EXPECT_THAT(scene.warnings, ElementsAre());
  ASSERT_EQ(scene.triangles.size(), 1u);
  EXPECT_EQ(scene.triangles[0].line, 7u);
  EXPECT_DOUBLE_EQ(scene.area(scene.triangles[0]), 200);
  EXPECT_EQ(scene.name, "room");
}

TEST(RrvXml, WarnsOfWhatItLeavesOut) {
  const Scene scene = read(
      "<scene>\n<fog/>\n<head>\n<light/>\n<objectdef name='o'><cuboid/>\n<cone/></objectdef>\n"
      "<objectdef name='o'/>\n</head><body>\n<shear dx='1'>\n<scale dx='1' dy='2'>\n<object "
      "name='o'/></scale></shear></body>\n<body/></scene>");
  EXPECT_THAT(scene.warnings, ElementsAre(AllOf(StartsWith("folder/room.xml:2: "), HasSubstr("<fog>")),
                                          AllOf(StartsWith("folder/room.xml:4: "), HasSubstr("<light>")),
                                          AllOf(StartsWith("folder/room.xml:7: "), HasSubstr("twice")),
                                          AllOf(StartsWith("folder/room.xml:12: "), HasSubstr("second <body>")),
                                          AllOf(StartsWith("folder/room.xml:6: "), HasSubstr("<cone>")),
                                          AllOf(StartsWith("folder/room.xml:9: "), HasSubstr("<shear>")),
                                          AllOf(StartsWith("folder/room.xml:10: "), HasSubstr("scale of 0"))));
}

TEST(RrvXml, WarningsAreBounded) {
  std::string many = "<cuboid/>";
  for (int i = 0; i < 1000; ++i) many += "<cone/>";
  const Scene scene = read(document(many));
  ASSERT_EQ(scene.warnings.size(), 51u);
  EXPECT_THAT(scene.warnings.back(), HasSubstr("950 more"));
}

TEST(RrvXml, RefusesWhatIsNotAScene) {
  EXPECT_THAT(message_of(""), HasSubstr("not XML"));
  EXPECT_THAT(message_of("hello"), HasSubstr("not XML"));
  EXPECT_THAT(message_of(std::string(100, '\0')), HasSubstr("not XML"));
  EXPECT_THAT(message_of("<html/>"), HasSubstr("not <scene>"));
  EXPECT_THAT(message_of("<scene/>"), HasSubstr("no <body>"));
  EXPECT_THAT(message_of("<scene><body/></scene>"), HasSubstr("no triangles"));
  EXPECT_THAT(message_of("<scene>\n<body>\n<cuboid></body></scene>"), AllOf(HasSubstr(":3: "), HasSubstr("not XML")));
}

TEST(RrvXml, EveryTruncationIsAnErrorOrAScene) {
  const std::string whole = document(one_triangle, "<scale dx='1' dy='1' dz='1'><object name='o'/></scale>");
  for (std::size_t length = 0; length < whole.size(); ++length) {
    EXPECT_THAT(message_of(whole.substr(0, length)), HasSubstr("not XML")) << length;
  }
}

TEST(RrvXml, NamesLineAndCauseOfBadValues) {
  const auto vertex = [](const std::string& attributes) {
    return document("\n<triangleset><triangle>\n<vertex x='0' y='0' z='0'/><vertex x='1' y='0' z='0'/>\n<vertex " +
                    attributes + "/></triangle></triangleset>");
  };
  EXPECT_THAT(message_of(vertex("x='1' y='2'")), HasSubstr("room.xml:4: <vertex> has no attribute 'z'"));
  for (const char* bad : {"nan", "inf", "-inf", "1e999", "", "1,5", "0x10", "1 2", "+-1", "--1", "abc"}) {
    EXPECT_THAT(message_of(vertex(fmt::format("x='1' y='2' z='{}'", bad))),
                AllOf(HasSubstr("room.xml:4: "), HasSubstr("not a finite number")))
        << bad;
  }
  for (const char* bad : {"", "1", "1,2", "1,2,3,4", "1,2,", ",,", "1 2 3", "1,nan,2", "red"}) {
    EXPECT_THAT(message_of(document(fmt::format("\n\n<cuboid reflectivity='{}'/>", bad))),
                AllOf(HasSubstr("room.xml:3: "), HasSubstr("three finite numbers")))
        << bad;
  }
  EXPECT_THAT(message_of(document("\n<cuboid emission='1,-1,1'/>")),
              HasSubstr("room.xml:2: <cuboid> emission is negative"));
  EXPECT_THAT(message_of(document("<cuboid/>", "\n<rotate angle='3'><object name='o'/></rotate>")),
              HasSubstr(":2: <rotate> has no axis"));
  EXPECT_THAT(message_of(document("<cuboid/>", "<translate dx='q'/>")), HasSubstr("<translate> dx"));
}

TEST(RrvXml, CountsVertices) {
  const std::string v = "<vertex x='0' y='0' z='0'/>";
  const auto set = [](const std::string& inside) { return document("\n<triangleset>\n" + inside + "</triangleset>"); };
  EXPECT_THAT(message_of(set("<triangle>" + v + v + "</triangle>")), HasSubstr(":3: <triangle> has 2 <vertex>, not 3"));
  EXPECT_THAT(message_of(set("<triangle>" + v + v + v + v + "</triangle>")), HasSubstr("more than 3 <vertex>"));
  EXPECT_THAT(message_of(set("<triangle>" + v + v + v + "</triangle><trianglenext/>")),
              HasSubstr("has 0 <vertex>, not 1"));
  EXPECT_THAT(message_of(set("<triangle>" + v + v + v + "</triangle><trianglenext>" + v + v + "</trianglenext>")),
              HasSubstr("more than 1 <vertex>"));
  EXPECT_THAT(message_of(set("<trianglenext>" + v + "</trianglenext>")),
              HasSubstr(":3: <trianglenext> has no <triangle> before it"));
}

TEST(RrvXml, BoundsDivisions) {
  for (const char* bad : {"0", "-1", "1.5", "1e9", "1e300", "nan", "257", "x"}) {
    EXPECT_THAT(message_of(document(fmt::format("\n<cuboid division='{}'/>", bad))),
                AllOf(HasSubstr(":2: "), HasSubstr("division")))
        << bad;
  }
  EXPECT_THAT(message_of(document("<barrel division='2'/>")), HasSubstr("from 3 to 4096"));
  EXPECT_THAT(message_of(document("<globe division='513'/>")), HasSubstr("from 3 to 512"));
  EXPECT_THAT(message_of(document("<teapot division='65'/>")), HasSubstr("from 1 to 64"));
}

TEST(RrvXml, MissingNamesAndObjects) {
  EXPECT_THAT(message_of("<scene><head>\n<objectdef/></head><body/></scene>"),
              HasSubstr(":2: <objectdef> has no attribute 'name'"));
  EXPECT_THAT(message_of(document("<cuboid/>", "\n<object/>")), HasSubstr(":2: <object> has no attribute 'name'"));
  EXPECT_THAT(message_of(document("<cuboid/>", "\n<object name='lamp'/>")),
              HasSubstr(":2: object 'lamp' is not defined"));
  EXPECT_THAT(message_of("<scene><head>\n<objectdef name='a' file='b.xml'/></head><body/></scene>"),
              HasSubstr("another file"));
}

TEST(RrvXml, ObjectsThatContainThemselves) {
  EXPECT_THAT(message_of(document("\n<object name='o'/>")), HasSubstr(":2: object 'o' contains itself"));
  EXPECT_THAT(message_of("<scene><head><objectdef name='a'><object name='b'/></objectdef>\n"
                         "<objectdef name='b'><translate><object name='a'/></translate></objectdef></head>"
                         "<body><object name='a'/></body></scene>"),
              HasSubstr(":2: object 'a' contains itself"));
}

/// Objects o0 .. o(levels), each holding `copies` of the one before.
std::string tower(int levels, int copies, const std::string& ground) {
  std::string head = "<objectdef name='o0'>" + ground + "</objectdef>";
  for (int i = 1; i <= levels; ++i) {
    head += fmt::format("<objectdef name='o{}'>", i);
    for (int c = 0; c < copies; ++c) head += fmt::format("<object name='o{}'/>", i - 1);
    head += "</objectdef>";
  }
  return fmt::format("<scene><head>{}</head><body><object name='o{}'/></body></scene>", head, levels);
}

TEST(RrvXml, ExponentialObjectsAreRefusedBeforeTheyAreMade) {
  EXPECT_EQ(read(tower(10, 2, one_triangle)).triangles.size(), 1024u);
  EXPECT_THAT(message_of(tower(40, 10, one_triangle)), HasSubstr("more than 4194304 triangles"));
  EXPECT_THAT(message_of(tower(99, 100, one_triangle)), HasSubstr("more than 4194304 triangles"));
  EXPECT_THAT(message_of(tower(60, 10, "<translate/>")), HasSubstr("elements"));  // nothing, very often
  std::string solids;
  for (int i = 0; i < 40; ++i) solids += "<teapot division='64'/>";
  EXPECT_THAT(message_of(document(solids)), HasSubstr("more than 4194304 triangles"));
}

TEST(RrvXml, DeepNestingIsRefused) {
  EXPECT_THAT(message_of(tower(1000, 1, one_triangle)), HasSubstr("nested more than"));
  std::string open, close;
  for (int i = 0; i < 100000; ++i) {
    open += "<translate>";
    close += "</translate>";
  }
  EXPECT_THAT(message_of(document("<cuboid/>", open + "<object name='o'/>" + close)), HasSubstr("nested more than"));
}

TEST(RrvXml, CoordinatesStayInReach) {
  EXPECT_THAT(message_of(document("<cuboid/>", "\n<scale dx='1e200' dy='1' dz='1'><object name='o'/></scale>")),
              HasSubstr("further out"));
  EXPECT_THAT(message_of(document("\n<cuboid/>",
                                  "<scale dx='1e200' dy='1' dz='1'><scale dx='1e200' dy='1' dz='1'><translate dx='1'>"
                                  "<object name='o'/></translate></scale></scale>")),
              HasSubstr(":2: a vertex lies further out"));
}

TEST(RrvXml, OddBytesInNamesArePrintable) {
  const Scene scene = read(document("<cuboid name='a\xff\xc3\xa9\xed\xa0\x80&lt;'/>"));
  EXPECT_EQ(scene.surfaces.at(0).group,
            "a?\xc3\xa9??"
            "?<");
  EXPECT_EQ(read(document(fmt::format("<cuboid name='{}'/>", std::string(100000, 'x')))).surfaces.at(0).group.size(),
            252u);
}

TEST(RrvXml, CustomEntitiesAreNotExpanded) {
  const Scene scene =
      read("<!DOCTYPE scene [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;'>]>" + document("<cuboid name='&b;'/>"));
  EXPECT_EQ(scene.surfaces.at(0).group, "&b;");
}

}  // namespace
}  // namespace interflect
