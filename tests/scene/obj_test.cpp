#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "scene/build_scene.h"
#include "scene/png_bytes.h"

namespace interflect {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::PngBytes;
using testing::TestFolder;

constexpr const char* square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

Scene read(const std::string& text) {
  return read_obj(text, "nowhere/test.obj");
}

double total_area(const Scene& scene) {
  double sum = 0;
  for (const Triangle& t : scene.triangles) sum += scene.area(t);
  return sum;
}

TEST(Obj, NamesOfObjectsGroupsAndMaterials) {
  const TestFolder folder;
  (void)folder.file("room.mtl",
                    "newmtl wall paint\nKd 0.1 0.2 0.3\n\nnewmtl lamp\n  Ke 10 20 30\nKd 0 0 0\nNs 10\nillum 2\n");
  const auto path = folder.file("room.obj", std::string("mtllib room.mtl\r\n") + square +
                                                "o table\ng top left\nusemtl wall paint\nf 1 2 3\n"
                                                "g legs\nf 1 3 4\nusemtl lamp\nf 1 2 4\no chair\nf 2 3 4\n");
  const Scene scene = read_scene(path);
  EXPECT_THAT(scene.warnings, ElementsAre());
  EXPECT_EQ(scene.name, "room");
  ASSERT_EQ(scene.triangles.size(), 4u);
  const auto surface = [&](std::size_t t) { return scene.surfaces[scene.triangles[t].surface]; };
  EXPECT_EQ(surface(0).object, "table");
  EXPECT_EQ(surface(0).group, "top left");
  EXPECT_EQ(surface(1).group, "legs");
  EXPECT_EQ(surface(2).group, "legs");
  EXPECT_EQ(surface(3).object, "chair");
  EXPECT_EQ(surface(3).group, "legs");
  EXPECT_EQ(scene.triangles[0].line, 9u);
  EXPECT_EQ(scene.triangles[3].line, 15u);
  const Material& wall = scene.materials[surface(0).material];
  EXPECT_EQ(wall.name, "wall paint");
  EXPECT_EQ(wall.reflectance, (Rgb{0.1, 0.2, 0.3}));
  EXPECT_EQ(wall.emittance, (Rgb{0, 0, 0}));
  const Material& lamp = scene.materials[surface(3).material];
  EXPECT_EQ(lamp.name, "lamp");
  EXPECT_EQ(lamp.reflectance, (Rgb{0, 0, 0}));
  EXPECT_EQ(lamp.emittance, (Rgb{10, 20, 30}));
  EXPECT_EQ(scene.materials.size(), 2u);
}

TEST(Obj, NumbersAreReadExactly) {
  const Scene scene = read("v 0.1 -2.5e-3 +1e2\nv 1e-400 .5 7.\nv 0 0 -0\nf 1 2 3\n");
  EXPECT_EQ(scene.positions[0], (Vec3{0.1, -2.5e-3, 100}));
  EXPECT_EQ(scene.positions[1], (Vec3{0, 0.5, 7}));
}

TEST(Obj, AllFormsOfCorners) {
  const std::string head = std::string(square) + "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n";
  for (const char* face : {"f 1 2 3", "f 1/1 2/2 3/3", "f 1//1 2//1 3//1", "f 1/1/1 2/2/1 3/3/1", "f\t1  2 3 # here"}) {
    const Scene scene = read(head + face + "\n");
    ASSERT_EQ(scene.triangles.size(), 1u) << face;
    EXPECT_EQ(scene.triangles[0].vertex, (std::array<std::uint32_t, 3>{0, 1, 2})) << face;
  }
}

TEST(Obj, NegativeIndicesCountFromTheLastVertexSoFar) {
  const Scene scene = read("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -1 -4 -3\n");
  EXPECT_EQ(scene.triangles[0].vertex, (std::array<std::uint32_t, 3>{1, 2, 3}));
  EXPECT_EQ(scene.triangles[1].vertex, (std::array<std::uint32_t, 3>{4, 1, 2}));
}

TEST(Obj, FacesMayComeBeforeTheirVertices) {
  EXPECT_EQ(read(std::string("f 1 2 3\n") + square).triangles[0].vertex, (std::array<std::uint32_t, 3>{0, 1, 2}));
}

TEST(Obj, PolygonsAreCutIntoTrianglesWithTheirWinding) {
  EXPECT_NEAR(total_area(read(std::string(square) + "f 1 2 3 4\n")), 1, 1e-15);
  const Scene arrow = read("v 0 0 0\nv 2 -2 0\nv 0 4 0\nv -2 -2 0\nf 2 3 4 1\n");  // concave at the last corner
  ASSERT_EQ(arrow.triangles.size(), 2u);
  EXPECT_NEAR(total_area(arrow), 8, 1e-12);
  for (const Triangle& t : arrow.triangles) {
    const Vec3 a = arrow.positions[t.vertex[0]], b = arrow.positions[t.vertex[1]], c = arrow.positions[t.vertex[2]];
    EXPECT_GT(cross(b - a, c - a).z, 0);
    EXPECT_EQ(t.line, 5u);
  }
}

TEST(Obj, ContinuedLinesCommentsAndLineEndings) {
  EXPECT_EQ(read("\xef\xbb\xbf# a file\nv 0 0 \\\n 0\nv 1 0 0\nv 0 1 0\n\n   \nf 1 \\\n2 \\\n3\n").triangles[0].line,
            8u);
  EXPECT_EQ(read("v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r").triangles[0].line, 4u);
  EXPECT_EQ(read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3").triangles.size(), 1u);
}

TEST(Obj, TheCameraComment) {
  const std::string head = std::string(square) + "f 1 2 3\n";
  const auto camera = read(head + "#camera eye 1 2 3 target 4 5 6 up 0 0 1 fov 90\n").camera;
  ASSERT_TRUE(camera.has_value());
  EXPECT_EQ(camera->eye, (Vec3{1, 2, 3}));
  EXPECT_EQ(camera->target, (Vec3{4, 5, 6}));
  EXPECT_EQ(camera->up, (Vec3{0, 0, 1}));
  EXPECT_DOUBLE_EQ(camera->vertical_fov, std::numbers::pi / 2);
  const auto plain = read(head + "#camera target 0 0 0 eye 0 0 9\n#camera eye 5 5 5 target 0 0 0\n").camera;
  ASSERT_TRUE(plain.has_value());
  EXPECT_EQ(plain->eye, (Vec3{0, 0, 9}));
  EXPECT_EQ(plain->up, (Vec3{0, 1, 0}));
  EXPECT_FALSE(read(head + "# camera of the author\n").camera.has_value());
}

TEST(Obj, MaterialsThatNoFileDefinesReflectAHalfAndAreWarnedOf) {
  const Scene scene = read(std::string("mtllib none.mtl\n") + square + "f 1 2 3\nusemtl brick\nf 1 3 4\n");
  ASSERT_EQ(scene.materials.size(), 2u);
  EXPECT_EQ(scene.materials[0].reflectance, (Rgb{0.5, 0.5, 0.5}));
  EXPECT_EQ(scene.materials[1].name, "brick");
  EXPECT_EQ(scene.materials[1].reflectance, (Rgb{0.5, 0.5, 0.5}));
  EXPECT_THAT(scene.warnings,
              ElementsAre(HasSubstr("test.obj:1: there is no material file 'none.mtl'"),
                          HasSubstr("faces without a material"), HasSubstr("no material file defines 'brick'")));
}

TEST(Obj, WhatAMaterialLeavesOpen) {
  const TestFolder folder;
  (void)folder.file("m.mtl",
                    "newmtl grey\nKd 0.7\nnewmtl lamp\nKe 4 5 6\nnewmtl empty\nnewmtl glass\nKd 1 1 1\nd 0.1\n"
                    "newmtl grey\nKd 0.9\n");
  const Scene scene = read_scene(folder.file(
      "m.obj", std::string("mtllib m.mtl\n") + square +
                   "usemtl grey\nf 1 2 3\nusemtl lamp\nf 1 2 4\nusemtl empty\nf 2 3 4\nusemtl glass\nf 1 3 4\n"));
  ASSERT_EQ(scene.materials.size(), 4u);
  EXPECT_EQ(scene.materials[0].reflectance, (Rgb{0.7, 0.7, 0.7}));
  EXPECT_EQ(scene.materials[1].reflectance, (Rgb{0, 0, 0}));
  EXPECT_EQ(scene.materials[1].emittance, (Rgb{4, 5, 6}));
  EXPECT_EQ(scene.materials[2].reflectance, (Rgb{0.5, 0.5, 0.5}));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("m.mtl:5: material 'empty' has no Kd"), HasSubstr("transparent"),
                                          HasSubstr("'grey' is defined twice")));
}

TEST(Obj, MaterialFilesWithSpacesSeveralNamesAndBackslashes) {
  const TestFolder folder;
  std::filesystem::create_directory(folder.path() / "sub");
  (void)folder.file("my room.mtl", "newmtl a\nKd 0.1 0.1 0.1\n");
  (void)folder.file("one.mtl", "newmtl b\nKd 0.2 0.2 0.2\n");
  (void)folder.file("sub/two.mtl", "newmtl c\nKd 0.3 0.3 0.3\n");
  const Scene scene =
      read_scene(folder.file("m.obj", std::string("mtllib my room.mtl\nmtllib one.mtl sub\\two.mtl\n") + square +
                                          "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 4\nusemtl c\nf 2 3 4\n"));
  EXPECT_THAT(scene.warnings, ElementsAre());
  for (std::size_t i = 0; i < 3; ++i) EXPECT_DOUBLE_EQ(scene.materials[i].reflectance[0], 0.1 * double(i + 1));
}

TEST(Obj, TexturesAreDecodedToLinearRgb) {
  const TestFolder folder;
  // Upper row white and black, lower row two greys; sRGB 188 is 0.5029 in linear light.
  (void)folder.file("t.png", PngBytes::make(2, 2, std::string("\xff\xff\xff\0\0\0\xbc\xbc\xbc\x80\x80\x80", 12)));
  (void)folder.file("m.mtl",
                    "newmtl a\nmap_Kd t.png\nnewmtl b\nKd 0.5 0.5 0.5\nKe 2 2 2\nmap_Kd -clamp on t.png\n"
                    "map_Ke t.png\n");
  const Scene scene = read_scene(folder.file(
      "m.obj", std::string("mtllib m.mtl\n") + square +
                   "vt 0 0\nvt 0.5 0\nvt 0.5 0.5\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 3/3 4/2\nf 1 2 4\n"));
  ASSERT_EQ(scene.images.size(), 1u) << "the same file is read once";
  const Image& image = scene.images[0];
  EXPECT_EQ(image.width, 2u);
  EXPECT_EQ(image.height, 2u);
  ASSERT_EQ(image.pixels.size(), 12u);
  EXPECT_FLOAT_EQ(image.pixels[0], 1);
  EXPECT_FLOAT_EQ(image.pixels[3], 0);
  EXPECT_NEAR(image.pixels[6], 0.5029, 1e-4);
  EXPECT_NEAR(image.pixels[9], 0.2159, 1e-4);
  EXPECT_EQ(scene.materials[0].reflectance, (Rgb{1, 1, 1}));
  EXPECT_EQ(scene.materials[1].emittance_image, 0);
  EXPECT_EQ(scene.triangles[2].uv, -1);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("m.mtl:6: texture options"), HasSubstr("texture coordinates: 1")));
  // The triangle lies in the lower left texel: OBJ counts v from the bottom.
  const PatchMesh mesh = subdivide(scene, {});
  EXPECT_NEAR(mesh.reflectance[0][0], 0.5029, 1e-4);
}

TEST(Obj, TexturesThatCannotBeReadAreWarnedOf) {
  const TestFolder folder;
  (void)folder.file("photo.jpg", "\xff\xd8\xff and so on");
  (void)folder.file("m.mtl", "newmtl a\nKd 0.3 0.3 0.3\nmap_Kd photo.jpg\nnewmtl b\nmap_Kd missing.png\n");
  const Scene scene = read_scene(
      folder.file("m.obj", std::string("mtllib m.mtl\n") + square + "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n"));
  EXPECT_EQ(scene.materials[0].reflectance_image, -1);
  EXPECT_EQ(scene.materials[0].reflectance, (Rgb{0.3, 0.3, 0.3}));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("photo.jpg: only PNG"), HasSubstr("missing.png: there is no")));
}

TEST(Obj, WhatIsNotSupportedIsCounted) {
  const Scene scene = read(std::string(square) + "s off\nvn 0 0 1\nl 1 2\nl 2 3\nsurf 0 1\nf 1 2 3\n");
  EXPECT_THAT(scene.warnings,
              ::testing::IsSupersetOf({HasSubstr("'l' statements are ignored: 2"), HasSubstr("'surf'")}));
  EXPECT_THAT(read(std::string(square) + "f 1 3 2 4\n").warnings, ::testing::Contains(HasSubstr(":5: a face whose")));
}

}  // namespace
}  // namespace interflect
