#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <numbers>

#include "interflect/base/error.h"
#include "interflect/scene/scene.h"
#include "scene/gltf_build.h"
#include "scene/png_bytes.h"

namespace interflect {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using testing::Gltf;
using ::testing::HasSubstr;
using testing::PngBytes;

Scene read(const Gltf& file) {
  return read_gltf(file.text(), "folder/room.gltf");
}

std::array<Vec3, 3> corners(const Scene& scene, std::size_t t) {
  const auto& v = scene.triangles.at(t).vertex;
  return {scene.positions.at(v[0]), scene.positions.at(v[1]), scene.positions.at(v[2])};
}

Vec3 normal(const Scene& scene, std::size_t t) {
  const auto [a, b, c] = corners(scene, t);
  return normalized(cross(b - a, c - a));
}

const Material& material(const Scene& scene, std::size_t t) {
  return scene.materials.at(scene.surfaces.at(scene.triangles.at(t).surface).material);
}

void expect_near(Vec3 a, Vec3 b, double tolerance = 1e-12) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST(Gltf, PlainTriangle) {
  Gltf file;
  file.add_triangle({{"name", "leaf"}});
  const Scene scene = read(file);
  ASSERT_EQ(scene.triangles.size(), 1u);
  EXPECT_EQ(corners(scene, 0), (std::array<Vec3, 3>{Vec3{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(scene.surfaces.at(0).object, "leaf");
  EXPECT_EQ(scene.name, "room");
  EXPECT_EQ(scene.file, "folder/room.gltf");
  EXPECT_EQ(material(scene, 0).reflectance, (Rgb{1, 1, 1}));
  EXPECT_EQ(material(scene, 0).emittance, (Rgb{0, 0, 0}));
  EXPECT_EQ(scene.triangles[0].uv, -1);
  EXPECT_FALSE(scene.camera.has_value());
}

TEST(Gltf, GlbIsTheSameAsText) {
  Gltf file;
  file.add_triangle({{"translation", {1, 2, 3}}});
  const Scene text = read(file), binary = read_gltf(file.glb(), "room.glb");
  EXPECT_EQ(text.positions, binary.positions);
  EXPECT_EQ(binary.triangles.size(), 1u);
}

TEST(Gltf, TransformationsNest) {
  const double h = std::numbers::sqrt2 / 2;
  Gltf file;
  file.add_triangle({{"translation", {10, 20, 30}}, {"rotation", {0, 0, h, h}}, {"scale", {2, 3, 4}}});
  file.json["nodes"].at(0)["children"] = {1};
  file.add("nodes", {{"mesh", 0}, {"matrix", {1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 5, 6, 7, 1}}});  // x to x, y to z
  const Scene scene = read(file);
  ASSERT_EQ(scene.triangles.size(), 2u);
  // Scaled to (2, 3), turned from x to y, moved.
  const auto [a, b, c] = corners(scene, 0);
  expect_near(a, {10, 20, 30});
  expect_near(b, {10, 22, 30});
  expect_near(c, {7, 20, 30});
  // The child: (x, y, z) -> (x + 5, 6 - z, y + 7) first.
  const auto [d, e, f] = corners(scene, 1);
  expect_near(d, {10 - 18, 20 + 10, 30 + 28});
  expect_near(e, {10 - 18, 20 + 12, 30 + 28});
  expect_near(f, {10 - 18, 20 + 10, 30 + 32});
}

TEST(Gltf, MirrorKeepsTheFront) {
  Gltf file;
  file.add_triangle();
  file.add_triangle({{"scale", {-1, 1, 1}}});
  file.add_triangle({{"scale", {-1, -1, 1}}});
  const Scene scene = read(file);
  for (std::size_t t = 0; t < 3; ++t) EXPECT_EQ(normal(scene, t), (Vec3{0, 0, 1})) << t;
}

TEST(Gltf, StripsFansAndLists) {
  // A zigzag whose strip faces +z, and the corners of a hexagon's half for the fan.
  const std::vector<float> zigzag{0, 0, 0, 0, -1, 0, 1, 0, 0, 1, -1, 0, 2, 0, 0, 2, -1, 0};
  const std::vector<float> fan{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, -1, 1, 0, -1, 0, 0};
  struct {
    int mode;
    std::vector<float> points;
    std::size_t triangles;
    double area;
  } const cases[] = {
      {5, zigzag, 4, 2}, {6, fan, 4, 2}, {4, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 5, 2, 0, 5, 0, 2, 5}, 2, 2.5}};
  for (const auto& c : cases) {
    for (const bool indexed : {false, true}) {
      Gltf file;
      json primitive{{"attributes", {{"POSITION", file.floats(c.points, "VEC3")}}}, {"mode", c.mode}};
      if (indexed) primitive["indices"] = file.indices(std::vector<std::uint16_t>{0, 1, 2, 3, 4, 5});
      file.add_root({{"mesh", file.add_mesh(primitive)}});
      const Scene scene = read(file);
      ASSERT_EQ(scene.triangles.size(), c.triangles) << c.mode;
      double area = 0;
      for (std::size_t t = 0; t < c.triangles; ++t) {
        EXPECT_EQ(normal(scene, t), (Vec3{0, 0, 1})) << c.mode << " " << t;
        area += scene.area(scene.triangles[t]);
      }
      EXPECT_DOUBLE_EQ(area, c.area);
      EXPECT_EQ(scene.positions.size(), 6u);
    }
  }
}

TEST(Gltf, IndexTypesShareVertices) {
  const auto count = [](auto type) {
    using Type = decltype(type);
    Gltf file;
    const json primitive{{"attributes", {{"POSITION", file.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, "VEC3")}}},
                         {"indices", file.indices(std::vector<Type>{0, 1, 2, 1, 3, 2})}};
    file.add_root({{"mesh", file.add_mesh(primitive)}});
    const Scene scene = read(file);
    return std::pair{scene.triangles.size(), scene.positions.size()};
  };
  const std::pair<std::size_t, std::size_t> expected{2, 4};
  EXPECT_EQ(count(std::uint8_t{}), expected);
  EXPECT_EQ(count(std::uint16_t{}), expected);
  EXPECT_EQ(count(std::uint32_t{}), expected);
}

TEST(Gltf, StrideAndOffset) {
  Gltf file;
  const int view = file.add_view(testing::raw(std::vector<float>{9, 9, 0, 0, 0, 7, 1, 0, 0, 7, 0, 1, 0}), 16);
  const int positions = file.add(
      "accessors", {{"bufferView", view}, {"byteOffset", 8}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}});
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", positions}}}})}});
  EXPECT_EQ(corners(read(file), 0), (std::array<Vec3, 3>{Vec3{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
}

TEST(Gltf, QuantisedPositions) {
  Gltf file;
  file.json["extensionsRequired"] = {"KHR_mesh_quantization"};
  const int plain = file.add_accessor(testing::raw(std::vector<std::int16_t>{0, 0, 0, 0, 300, 0, 0, 0, 0, -400, 0, 0}),
                                      5122, 3, "VEC3");
  file.json["bufferViews"][0]["byteStride"] = 8;
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", plain}}}})}});
  const int unit = file.add_accessor(testing::raw(std::vector<std::int8_t>{-128, 0, 0, 0, 127, 0, 0, 0, 0, -127, 0, 0}),
                                     5120, 3, "VEC3");
  file.json["bufferViews"][1]["byteStride"] = 4;
  file.json["accessors"].at(1)["normalized"] = true;
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", unit}}}})}});
  const Scene scene = read(file);
  EXPECT_EQ(corners(scene, 0), (std::array<Vec3, 3>{Vec3{0, 0, 0}, {300, 0, 0}, {0, -400, 0}}));
  EXPECT_EQ(corners(scene, 1), (std::array<Vec3, 3>{Vec3{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}}));
}

TEST(Gltf, SparseAccessor) {
  Gltf file;
  const int index = file.add_view(std::string("\x01\x02", 2));
  const int value = file.add_view(testing::raw(std::vector<float>{4, 0, 0, 0, 5, 0}));
  const json sparse{
      {"count", 2}, {"indices", {{"bufferView", index}, {"componentType", 5121}}}, {"values", {{"bufferView", value}}}};
  const int zeros =
      file.add("accessors", {{"componentType", 5126}, {"count", 3}, {"type", "VEC3"}, {"sparse", sparse}});
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", zeros}}}})}});
  const int dense = file.floats({1, 1, 1, 2, 2, 2, 3, 3, 3}, "VEC3");
  file.json["accessors"].at(1)["sparse"] = sparse;
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", dense}}}})}});
  const Scene scene = read(file);
  EXPECT_EQ(corners(scene, 0), (std::array<Vec3, 3>{Vec3{0, 0, 0}, {4, 0, 0}, {0, 5, 0}}));
  EXPECT_EQ(corners(scene, 1), (std::array<Vec3, 3>{Vec3{1, 1, 1}, {4, 0, 0}, {0, 5, 0}}));
}

TEST(Gltf, MaterialFactors) {
  Gltf file;
  file.add("materials", {{"name", "lamp"},
                         {"doubleSided", true},
                         {"pbrMetallicRoughness", {{"baseColorFactor", {.1, .2, .3, 1}}, {"metallicFactor", 1}}},
                         {"emissiveFactor", {1, .5, .25}},
                         {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 8}}}}}});
  file.add("materials", json::object());
  file.add_triangle(json::object(), 0);
  file.add_triangle(json::object(), 1);
  const Scene scene = read(file);
  EXPECT_EQ(material(scene, 0).name, "lamp");
  EXPECT_TRUE(material(scene, 0).two_sided);
  EXPECT_EQ(material(scene, 0).reflectance, (Rgb{.1, .2, .3}));
  EXPECT_EQ(material(scene, 0).emittance, (Rgb{8, 4, 2}));
  EXPECT_EQ(material(scene, 1).name, "material 1");
  EXPECT_FALSE(material(scene, 1).two_sided);
  EXPECT_EQ(material(scene, 1).reflectance, (Rgb{1, 1, 1}));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("metallic")));
}

double srgb(double c) {
  return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
}

TEST(Gltf, TexturesAreDecodedToLinear) {
  const std::string texels = "\xbc\xbc\xbc\xff" + std::string("\0\0\0\xff\0\x0a\x80\xfe", 8);  // 2 x 2 RGB
  Gltf file;
  const int texture = file.add_texture(PngBytes::make(2, 2, texels));
  file.add("materials", {{"pbrMetallicRoughness",
                          {{"baseColorTexture", {{"index", texture}}}, {"baseColorFactor", {.5, .5, .5, 1}}}},
                         {"emissiveTexture", {{"index", texture}}},
                         {"emissiveFactor", {1, 1, 1}}});
  file.add_triangle(json::object(), 0);
  for (const std::string& bytes : {file.text(), file.glb()}) {
    const Scene scene = read_gltf(bytes, "a.gltf");
    ASSERT_EQ(scene.images.size(), 1u);  // shared
    const Image& image = scene.images[0];
    ASSERT_EQ(image.width, 2u);
    ASSERT_EQ(image.height, 2u);
    ASSERT_EQ(image.pixels.size(), 12u);
    EXPECT_NEAR(image.pixels[0], 0.503, 5e-4);
    for (std::size_t i = 0; i < 12; ++i) {
      EXPECT_NEAR(image.pixels[i], srgb(static_cast<unsigned char>(texels[i]) / 255.0), 1e-6) << i;
    }
    EXPECT_EQ(material(scene, 0).reflectance_image, 0);
    EXPECT_EQ(material(scene, 0).emittance_image, 0);
    EXPECT_EQ(material(scene, 0).reflectance, (Rgb{.5, .5, .5}));
    ASSERT_EQ(scene.triangles[0].uv, 0);
    EXPECT_THAT(scene.uvs, ElementsAre(Vec2{0, 0}, Vec2{1, 0}, Vec2{0, 1}));
  }
}

TEST(Gltf, SixteenBitTexture) {
  Gltf file;
  const std::string texel("\x80\x00\x01\x00\xff\xff", 6);  // big-endian
  const int texture = file.add_texture(PngBytes::make(1, 1, texel, 16));
  file.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", texture}}}}}});
  file.add_triangle(json::object(), 0);
  const Scene scene = read(file);
  ASSERT_EQ(scene.images.at(0).pixels.size(), 3u);
  EXPECT_NEAR(scene.images[0].pixels[0], srgb(0x8000 / 65535.0), 1e-6);
  EXPECT_NEAR(scene.images[0].pixels[1], srgb(0x0100 / 65535.0), 1e-6);
  EXPECT_EQ(scene.images[0].pixels[2], 1);
}

TEST(Gltf, JpegTexture) {
  Gltf file;
  file.add("images", {{"uri", std::string("data:image/jpeg;base64,") + testing::grey_jpeg_base64}});
  file.add("textures", {{"source", 0}});
  file.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  file.add_triangle(json::object(), 0);
  const Scene scene = read(file);
  ASSERT_EQ(scene.images.at(0).pixels.size(), 3u);
  EXPECT_NEAR(scene.images[0].pixels[0], srgb(188 / 255.0), 0.01);  // JPEG loses a step or two
}

TEST(Gltf, TextureSetAndTransform) {
  Gltf file;
  const int texture = file.add_texture(PngBytes::make(1, 1, "abc"));
  const json transform{{"offset", {.5, .25}}, {"rotation", std::numbers::pi / 2}, {"scale", {2, 3}}};
  file.add("materials",
           {{"pbrMetallicRoughness",
             {{"baseColorTexture",
               {{"index", texture}, {"texCoord", 1}, {"extensions", {{"KHR_texture_transform", transform}}}}}}}});
  file.add_triangle(json::object(), 0);
  file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] =
      file.add_accessor(std::string("\x00\x00\xff\x00\x00\xff", 6), 5121, 3, "VEC2");
  file.json["accessors"].back()["normalized"] = true;
  const Scene scene = read(file);
  // (u, v) -> (2u, 3v), a quarter turn that takes u to -v (upwards in the image), moved.
  ASSERT_EQ(scene.uvs.size(), 3u);
  const Vec2 expected[] = {{.5, .25}, {.5, .25 - 2}, {.5 + 3, .25}};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(scene.uvs[i].x, expected[i].x, 1e-12);
    EXPECT_NEAR(scene.uvs[i].y, expected[i].y, 1e-12);
  }
}

TEST(Gltf, TwoMappingsAverageTheEmissiveTexture) {
  Gltf file;
  const int texture = file.add_texture(PngBytes::make(2, 1, std::string("\xff\xff\xff\0\0\0", 6)));
  file.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", texture}}}}},
                         {"emissiveTexture", {{"index", texture}, {"texCoord", 1}}},
                         {"emissiveFactor", {1, 1, .5}}});
  file.add_triangle(json::object(), 0);
  const Scene scene = read(file);
  EXPECT_EQ(material(scene, 0).reflectance_image, 0);
  EXPECT_EQ(material(scene, 0).emittance_image, -1);
  EXPECT_EQ(material(scene, 0).emittance, (Rgb{.5, .5, .25}));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("averaged")));
}

TEST(Gltf, FirstPerspectiveCameraOfTheScene) {
  const double h = std::numbers::sqrt2 / 2;
  Gltf file;
  file.add("cameras",
           {{"type", "orthographic"}, {"orthographic", {{"xmag", 1}, {"ymag", 1}, {"zfar", 2}, {"znear", 1}}}});
  file.add("cameras", {{"type", "perspective"}, {"perspective", {{"yfov", .7}, {"znear", .1}}}});
  file.add("cameras", {{"type", "perspective"}, {"perspective", {{"yfov", .9}, {"znear", .1}}}});
  file.add_triangle();
  file.add_root({{"camera", 0}});
  file.add_root({{"camera", 1}, {"translation", {1, 2, 3}}, {"rotation", {0, h, 0, h}}});  // -z turns to -x
  file.add_root({{"camera", 2}});
  const Scene scene = read(file);
  ASSERT_TRUE(scene.camera.has_value());
  expect_near(scene.camera->eye, {1, 2, 3});
  expect_near(scene.camera->target, {0, 2, 3});
  expect_near(scene.camera->up, {0, 1, 0});
  EXPECT_DOUBLE_EQ(scene.camera->vertical_fov, .7);
}

TEST(Gltf, ScenesAndNames) {
  Gltf file;
  file.add_triangle({{"name", "room"}, {"children", {1, 2}}});
  file.add("nodes", {{"name", "chair"}, {"mesh", 0}});
  file.add("nodes", {{"mesh", 0}});
  file.json["meshes"][0]["name"] = "seat";
  file.add("nodes", {{"mesh", 0}, {"name", "elsewhere"}});
  file.json["scenes"].push_back({{"nodes", {3}}});
  const auto objects = [](const Scene& scene) {
    std::vector<std::string> names;
    for (const Surface& s : scene.surfaces) names.push_back(s.group + "/" + s.object);
    return names;
  };
  EXPECT_THAT(objects(read(file)), ElementsAre("room/room", "room/chair", "room/seat"));
  file.json["scene"] = 1;
  EXPECT_THAT(objects(read(file)), ElementsAre("elsewhere/elsewhere"));
  file.json.erase("scene");
  file.json.erase("scenes");
  EXPECT_THAT(objects(read(file)), ElementsAre("room/room", "room/chair", "room/seat", "elsewhere/elsewhere"));
}

TEST(Gltf, WarnsOfWhatItLeavesOut) {
  Gltf file;
  file.json["extensionsUsed"] = {"KHR_texture_transform", "KHR_lights_punctual"};
  file.json["animations"] = {{{"channels", json::array()}, {"samplers", json::array()}}};
  file.add("materials", {{"alphaMode", "BLEND"}});
  file.add_triangle(json::object(), 0);
  file.json["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", 0}}}, {"mode", 1}});
  EXPECT_THAT(read(file).warnings, ElementsAre(HasSubstr("KHR_lights_punctual"), HasSubstr("animations"),
                                               HasSubstr("alphaMode"), HasSubstr("points and lines")));
}

class GltfFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(::testing::TempDir()) / fmt::format("gltf-{}-{}", test->name(), ::getpid());
    std::filesystem::create_directories(folder_ / "inner");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }
  std::filesystem::path folder_;
};

TEST_F(GltfFiles, ReadsBuffersAndImagesBesideIt) {
  const std::string points = testing::raw(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 1, 0});
  write("inner/my points.bin", points);
  write("inner/wood.png", PngBytes::make(1, 1, "\xff\xff\xff"));
  Gltf file;
  file.add("buffers", {{"byteLength", 36}, {"uri", "inner/my%20points.bin"}});
  file.add("bufferViews", {{"buffer", 0}, {"byteLength", 36}});
  file.add("accessors", {{"bufferView", 0}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}});
  file.add("images", {{"uri", "inner/wood.png"}});
  file.add("textures", {{"source", 0}});
  file.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", 0}}}, {"material", 0}})}});
  const Scene scene = read_gltf(file.text(), folder_ / "room.gltf");
  EXPECT_EQ(scene.triangles.size(), 1u);
  EXPECT_THAT(scene.images.at(0).pixels, ElementsAre(1, 1, 1));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("TEXCOORD_0")));
  EXPECT_THAT(scene.uvs, ElementsAre(Vec2{}, Vec2{}, Vec2{}));

  const auto message = [&](const char* list, const std::string& uri) -> std::string {
    file.json[list][0]["uri"] = uri;
    try {
      (void)read_gltf(file.text(), folder_ / "inner" / "room.gltf");
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      return error.what();
    }
    return "read";
  };
  write("points.bin", points);
  file.json["images"][0]["uri"] = "wood.png";
  EXPECT_THAT(message("buffers", "../points.bin"), HasSubstr("outside the folder"));
  EXPECT_THAT(message("buffers", "%2e%2e/points.bin"), HasSubstr("outside the folder"));
  EXPECT_THAT(message("buffers", (folder_ / "points.bin").string()), HasSubstr("outside the folder"));
  EXPECT_THAT(message("buffers", "none.bin"), HasSubstr("none.bin"));
  EXPECT_THAT(message("buffers", "http://localhost/a.bin"), HasSubstr("only files"));
  EXPECT_THAT(message("buffers", "wood.png"), HasSubstr("size mismatch"));
  EXPECT_EQ(message("buffers", "my%20points.bin"), "read");
  EXPECT_THAT(message("images", "../wood.png"), HasSubstr("outside the folder"));
  EXPECT_THAT(message("images", "none.png"), HasSubstr("image 0 ('none.png') cannot be read"));
  EXPECT_THAT(message("images", "my%20points.bin"), HasSubstr("neither PNG nor JPEG"));
}

}  // namespace
}  // namespace interflect
