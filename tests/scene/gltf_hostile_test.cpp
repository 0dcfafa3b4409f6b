#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "interflect/base/error.h"
#include "interflect/scene/scene.h"
#include "scene/gltf_build.h"
#include "scene/png_bytes.h"

namespace interflect {
namespace {

using nlohmann::json;
using testing::Gltf;
using ::testing::HasSubstr;
using testing::PngBytes;
using ::testing::StartsWith;

/// The error's message; the test fails when there is none or it is not an input error naming the file.
std::string message_of(const std::string& bytes) {
  try {
    (void)read_gltf(bytes, "folder/room.gltf");
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input) << error.what();
    EXPECT_THAT(error.what(), StartsWith("folder/room.gltf: "));
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  ADD_FAILURE() << "no error for " << bytes.substr(0, 200);
  return {};
}

/// A good file with two triangles that share an edge, an indexed mesh and a texture.
Gltf good() {
  Gltf file;
  const json primitive{{"attributes",
                        {{"POSITION", file.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, "VEC3")},
                         {"TEXCOORD_0", file.floats({0, 0, 1, 0, 0, 1, 1, 1}, "VEC2")}}},
                       {"indices", file.indices(std::vector<std::uint16_t>{0, 1, 2, 1, 3, 2})},
                       {"material", 0}};
  const int texture = file.add_texture(PngBytes::make(2, 2, "abcdefghijkl"));
  file.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", texture}}}}}});
  file.add_root({{"name", "lamp"}, {"mesh", file.add_mesh(primitive)}});
  return file;
}

/// The message after the JSON value at `pointer` was replaced.
std::string spoilt(const std::string& pointer, const json& value) {
  Gltf file = good();
  file.json[json::json_pointer(pointer)] = value;
  return message_of(file.text());
}

std::string without(const std::string& parent, const std::string& key) {
  Gltf file = good();
  file.json[json::json_pointer(parent)].erase(key);
  return message_of(file.text());
}

TEST(GltfHostile, TheGoodFileIsGood) {
  EXPECT_EQ(read_gltf(good().text(), "a.gltf").triangles.size(), 2u);
  EXPECT_EQ(read_gltf(good().glb(), "a.glb").triangles.size(), 2u);
}

TEST(GltfHostile, NotGltf) {
  EXPECT_THAT(message_of(""), HasSubstr("not JSON"));
  EXPECT_THAT(message_of("hello"), HasSubstr("not JSON"));
  EXPECT_THAT(message_of(std::string(64, '\0')), HasSubstr("not JSON"));
  EXPECT_THAT(message_of("[1, 2]"), HasSubstr("not an object"));
  EXPECT_THAT(message_of("{}"), HasSubstr("'asset' has no 'version'"));
  EXPECT_THAT(message_of(R"({"asset": {"version": "1.0"}})"), HasSubstr("version 1.0 is not 2"));
  EXPECT_THAT(message_of(R"({"asset": {"version": 2}})"), HasSubstr("'asset' has no 'version'"));
  EXPECT_THAT(message_of(R"({"asset": {"version": "2.0"}})"), HasSubstr("no triangles"));
  EXPECT_THAT(message_of("{\"asset\": {\"version\": \"2.0\xff\"}}"), HasSubstr("not JSON"));
}

TEST(GltfHostile, EveryTruncationIsAnError) {
  const std::string text = good().text(), glb = good().glb();
  for (std::size_t n = 0; n < text.size(); n += 7) (void)message_of(text.substr(0, n));
  for (std::size_t n = 0; n < glb.size(); n += 3) (void)message_of(glb.substr(0, n));
}

TEST(GltfHostile, GlbHeader) {
  const std::string glb = good().glb();
  const auto with = [&](std::size_t at, std::uint32_t value) {
    std::string bytes = glb;
    bytes.replace(at, 4, testing::raw(std::vector<std::uint32_t>{value}));
    return message_of(bytes);
  };
  std::uint32_t json_length = 0;
  std::memcpy(&json_length, glb.data() + 12, 4);
  EXPECT_THAT(with(0, 0x20202020), HasSubstr("not JSON"));  // wrong magic
  EXPECT_THAT(with(4, 1), HasSubstr("version 1"));
  EXPECT_THAT(with(8, 0xffffffff), HasSubstr("truncated"));
  EXPECT_THAT(with(8, 16), HasSubstr("does not fit"));
  EXPECT_THAT(with(12, 0xfffffffc), HasSubstr("JSON chunk"));
  EXPECT_THAT(with(12, json_length + 1), HasSubstr("JSON chunk"));
  EXPECT_THAT(with(16, 0), HasSubstr("not JSON"));
  EXPECT_THAT(with(20 + json_length, 0xfffffffc), HasSubstr("BIN chunk"));
  // Eight bytes more than there are: what tinygltf 2.7 lets pass.
  const auto rest = static_cast<std::uint32_t>(glb.size()) - 20 - json_length;
  EXPECT_THAT(with(20 + json_length, rest), HasSubstr("BIN chunk"));
  EXPECT_THAT(with(24 + json_length, 0), HasSubstr("chunk1"));
}

TEST(GltfHostile, VersionsAndExtensions) {
  Gltf file = good();
  file.json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  EXPECT_THAT(message_of(file.text()), HasSubstr("KHR_draco_mesh_compression"));
  file.json["extensionsRequired"] = {7};
  EXPECT_THAT(message_of(file.text()), HasSubstr("requires the extension"));
}

TEST(GltfHostile, Buffers) {
  EXPECT_THAT(spoilt("/bufferViews/0/byteLength", 1000000), HasSubstr("bufferView 0 reaches beyond buffer 0"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteOffset", 1000000), HasSubstr("bufferView 0 reaches beyond"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteOffset", std::numeric_limits<std::uint64_t>::max()),
              HasSubstr("bufferView 0"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteLength", std::numeric_limits<std::uint64_t>::max()),
              HasSubstr("bufferView 0"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteLength", 0), HasSubstr("bufferView 0"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteLength", -4), HasSubstr("bufferView 0: 'byteLength'"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteLength", "many"), HasSubstr("bufferView 0: 'byteLength'"));
  EXPECT_THAT(spoilt("/bufferViews/0/buffer", 1), HasSubstr("bufferView 0: buffer 1 does not exist"));
  EXPECT_THAT(spoilt("/bufferViews/0", 5), HasSubstr("bufferView 0"));
  EXPECT_THAT(spoilt("/bufferViews", 5), HasSubstr("'bufferViews' is not an array"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteStride", 4), HasSubstr("stride of bufferView 0"));
  EXPECT_THAT(spoilt("/bufferViews/0/byteStride", 3), HasSubstr("byteStride"));
  EXPECT_THAT(without("/bufferViews/0", "byteLength"), HasSubstr("'byteLength' is missing"));
  const auto buffer = [](const json& value) {
    Gltf file = good();
    file.json["buffers"] = json::array({value});
    return message_of(file.text());
  };
  EXPECT_THAT(buffer({{"byteLength", 1000000}}), HasSubstr("buffer 0 has no 'uri'"));
  EXPECT_THAT(buffer({{"byteLength", 0}, {"uri", "x"}}), HasSubstr("buffer 0: byteLength is 0"));
  EXPECT_THAT(buffer({{"byteLength", 1ull << 40}, {"uri", "x"}}), HasSubstr("buffer 0: byteLength"));
  EXPECT_THAT(buffer({{"uri", "x"}}), HasSubstr("buffer 0: 'byteLength' is missing"));
  EXPECT_THAT(buffer({{"byteLength", 1000000}, {"uri", "nowhere.bin"}}), HasSubstr("nowhere.bin"));
  EXPECT_THAT(buffer({{"byteLength", 1000000}, {"uri", "data:application/octet-stream;base64,AAAA"}}),
              HasSubstr("uri"));
  EXPECT_THAT(buffer({{"byteLength", 1000000}, {"uri", "data:application/octet-stream;base64,"}}), HasSubstr("uri"));
  EXPECT_THAT(buffer({{"byteLength", 1000000}, {"uri", "data:something/else;base64,AAAA"}}), HasSubstr("only files"));
}

TEST(GltfHostile, ManyBuffersDoNotCopyTheBinaryChunk) {
  Gltf file = good();
  for (int i = 0; i < 3; ++i) file.add("buffers", {{"byteLength", 8}});
  EXPECT_THAT(message_of(file.glb()), HasSubstr("buffer 1 has no 'uri'"));
}

TEST(GltfHostile, Accessors) {
  EXPECT_THAT(spoilt("/accessors/0/count", 5), HasSubstr("accessor 0 with 5 elements reaches beyond bufferView 0"));
  EXPECT_THAT(spoilt("/accessors/0/count", 1ull << 62), HasSubstr("accessor 0"));
  EXPECT_THAT(spoilt("/accessors/0/count", std::numeric_limits<std::uint64_t>::max()), HasSubstr("accessor 0"));
  EXPECT_THAT(spoilt("/accessors/0/byteOffset", 4), HasSubstr("accessor 0"));
  EXPECT_THAT(spoilt("/accessors/0/byteOffset", std::numeric_limits<std::uint64_t>::max() - 3),
              HasSubstr("accessor 0"));
  EXPECT_THAT(spoilt("/accessors/0/bufferView", 99), HasSubstr("bufferView 99"));
  EXPECT_THAT(spoilt("/accessors/0/componentType", 5124), HasSubstr("component type"));
  EXPECT_THAT(spoilt("/accessors/0/componentType", 5130), HasSubstr("component type"));
  EXPECT_THAT(spoilt("/accessors/0/componentType", 1), HasSubstr("componentType"));
  EXPECT_THAT(spoilt("/accessors/0/type", "VEC2"), HasSubstr("accessor 0 has the wrong type"));
  EXPECT_THAT(spoilt("/accessors/0/type", "VEC9"), HasSubstr("VEC9"));
  EXPECT_THAT(without("/accessors/0", "bufferView"), HasSubstr("accessor 0 has no bufferView"));
  EXPECT_THAT(spoilt("/accessors/1/count", 3), HasSubstr("TEXCOORD_0 is shorter than POSITION"));
  EXPECT_THAT(spoilt("/accessors/2/componentType", 5122), HasSubstr("not unsigned integers"));
  EXPECT_THAT(spoilt("/accessors/2/count", 5), HasSubstr("5 corners are not whole triangles"));
  EXPECT_THAT(spoilt("/accessors/2/bufferView", 77), HasSubstr("bufferView"));
  EXPECT_THAT(spoilt("/accessors", json::object()), HasSubstr("out of bounds"));
}

TEST(GltfHostile, SparseAccessors) {
  const json sparse{
      {"count", 1}, {"indices", {{"bufferView", 2}, {"componentType", 5123}}}, {"values", {{"bufferView", 0}}}};
  const auto with = [&](const std::string& pointer, const json& value) {
    json spoilt_sparse = sparse;
    spoilt_sparse[json::json_pointer(pointer)] = value;
    return spoilt("/accessors/0/sparse", spoilt_sparse);
  };
  EXPECT_THAT(with("/count", 5), HasSubstr("sparse count"));
  EXPECT_THAT(with("/count", -1), HasSubstr("sparse count"));
  EXPECT_THAT(with("/indices/bufferView", 9), HasSubstr("bufferView 9"));
  EXPECT_THAT(with("/indices/bufferView", -1), HasSubstr("bufferView -1"));
  EXPECT_THAT(with("/indices/componentType", 5126), HasSubstr("sparse indices"));
  EXPECT_THAT(with("/indices/byteOffset", 2000000), HasSubstr("reaches beyond"));
  EXPECT_THAT(with("/indices/byteOffset", -8), HasSubstr("offset"));
  EXPECT_THAT(with("/values/bufferView", 9), HasSubstr("bufferView 9"));
  EXPECT_THAT(with("/values/byteOffset", 44), HasSubstr("reaches beyond"));
  EXPECT_THAT(spoilt("/accessors/0/sparse", {{"count", 1}}), HasSubstr("indices"));
  Gltf file = good();
  file.json["accessors"][0]["sparse"] = sparse;
  file.json["accessors"][0]["sparse"]["indices"]["bufferView"] = file.add_view("\x09\x01");
  EXPECT_THAT(message_of(file.text()), HasSubstr("sparse index 265 of 4"));
}

TEST(GltfHostile, ALargeCountWithoutDataAllocatesNothing) {
  Gltf file;
  const int index = file.add_view(std::string("\x01\x02", 2));
  const int value = file.add_view(testing::raw(std::vector<float>{4, 0, 0, 0, 5, 0}));
  const json sparse{
      {"count", 2}, {"indices", {{"bufferView", index}, {"componentType", 5121}}}, {"values", {{"bufferView", value}}}};
  const int zeros =
      file.add("accessors", {{"componentType", 5126}, {"count", 3ull << 50}, {"type", "VEC3"}, {"sparse", sparse}});
  file.add_root({{"mesh", file.add_mesh({{"attributes", {{"POSITION", zeros}}}})}});
  EXPECT_THAT(message_of(file.text()), HasSubstr("more than 4194304 triangles"));
}

TEST(GltfHostile, Meshes) {
  const std::string p = "/meshes/0/primitives/0";
  EXPECT_THAT(spoilt(p + "/attributes/POSITION", 50), HasSubstr("accessor 50 does not exist"));
  EXPECT_THAT(spoilt(p + "/attributes/POSITION", -3), HasSubstr("accessor -3 does not exist"));
  EXPECT_THAT(without(p + "/attributes", "POSITION"), HasSubstr("mesh 0 ('') primitive 0 has no POSITION"));
  EXPECT_THAT(spoilt(p + "/indices", 50), HasSubstr("out of bounds"));
  EXPECT_THAT(spoilt(p + "/mode", 7), HasSubstr("mode 7"));
  EXPECT_THAT(spoilt(p + "/material", 4), HasSubstr("material 4: does not exist"));
  EXPECT_THAT(without(p, "attributes"), HasSubstr("attributes"));
  EXPECT_THAT(spoilt("/meshes/0/primitives", {1, 2}), HasSubstr("attributes"));
  EXPECT_THAT(spoilt("/nodes/0/mesh", 4), HasSubstr("mesh 4 does not exist"));
}

TEST(GltfHostile, IndicesOutOfRange) {
  Gltf file;
  const json primitive{{"attributes", {{"POSITION", file.floats({0, 0, 0, 1, 0, 0, 0, 1, 0}, "VEC3")}}},
                       {"indices", file.indices(std::vector<std::uint32_t>{0, 1, 0xffffffff})}};
  file.add_root({{"mesh", file.add_mesh(primitive)}});
  EXPECT_THAT(message_of(file.text()), HasSubstr("index 4294967295 of 3 vertices"));
}

TEST(GltfHostile, Nodes) {
  EXPECT_THAT(spoilt("/nodes/0/children", {0}), HasSubstr("node 0 ('lamp') is reached twice"));
  EXPECT_THAT(spoilt("/nodes/0/children", {5}), HasSubstr("node 5 does not exist"));
  EXPECT_THAT(spoilt("/nodes/0/children", {-1}), HasSubstr("node -1 does not exist"));
  EXPECT_THAT(spoilt("/scenes/0/nodes", {0, 0}), HasSubstr("reached twice"));
  EXPECT_THAT(spoilt("/scenes/0/nodes", {3}), HasSubstr("node 3 does not exist"));
  EXPECT_THAT(spoilt("/scene", 3), HasSubstr("scene 3 does not exist"));
  EXPECT_THAT(spoilt("/nodes/0/matrix", {1, 2, 3}), HasSubstr("node 0 ('lamp'): matrix has 3 numbers"));
  EXPECT_THAT(spoilt("/nodes/0/matrix", {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}), HasSubstr("not affine"));
  EXPECT_THAT(spoilt("/nodes/0/scale", {1, 2}), HasSubstr("scale has 2 numbers"));
  EXPECT_THAT(spoilt("/nodes/0/rotation", {0, 0, 0, 0}), HasSubstr("not a quaternion"));
  EXPECT_THAT(spoilt("/nodes/0/translation", {1e300, 0, 0}), HasSubstr("further out"));
  EXPECT_THAT(spoilt("/nodes/0/scale", {1e200, 1, 1}), HasSubstr("further out"));
}

TEST(GltfHostile, NodeGraphs) {
  Gltf cycle = good();
  cycle.add("nodes", {{"children", {2}}});
  cycle.add("nodes", {{"children", {1}}});
  cycle.json["nodes"][0]["children"] = {1};
  EXPECT_THAT(message_of(cycle.text()), HasSubstr("node 1 is reached twice"));
  Gltf lattice = good();  // each node reaches the next by two ways: 2^40 visits
  for (int i = 0; i < 40; ++i) lattice.add("nodes", {{"children", {i + 2, i + 2}}});
  lattice.add("nodes", json::object());
  lattice.json["nodes"][0]["children"] = {1};
  EXPECT_THAT(message_of(lattice.text()), HasSubstr("reached twice"));
  Gltf chain = good();  // deep, but a tree
  for (int i = 1; i < 20000; ++i) chain.json["nodes"].push_back({{"children", {i + 1}}});
  chain.json["nodes"].push_back({{"mesh", 0}});
  chain.json["nodes"][0]["children"] = {1};
  EXPECT_EQ(read_gltf(chain.text(), "a.gltf").triangles.size(), 4u);
}

TEST(GltfHostile, ManyInstancesOfNothing) {
  Gltf file = good();
  json& primitives = file.json["meshes"][0]["primitives"];
  const int empty = file.floats({}, "VEC3");
  file.json["bufferViews"].back()["byteLength"] = 1;
  file.json["bufferViews"].back()["byteOffset"] = 0;
  for (int i = 0; i < 3000; ++i) primitives.push_back({{"attributes", {{"POSITION", empty}}}});
  for (int i = 0; i < 3000; ++i) file.add_root({{"mesh", 0}});
  EXPECT_THAT(message_of(file.text()), HasSubstr("more than 4194304 triangles"));
}

TEST(GltfHostile, CoordinatesAreFinite) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 1e30f}) {
    Gltf file;
    file.add_root({{"mesh", file.add_mesh({{"attributes",
                                            {{"POSITION", file.floats({0, 0, 0, 1, 0, bad, 0, 1, 0}, "VEC3")}}}})}});
    EXPECT_THAT(message_of(file.text()), HasSubstr("primitive 0: vertex 1 is not finite"));
  }
  Gltf file = good();
  file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] =
      file.floats(std::vector<float>(8, std::numeric_limits<float>::quiet_NaN()), "VEC2");
  EXPECT_THAT(message_of(file.text()), HasSubstr("texture coordinate 0"));
}

TEST(GltfHostile, Materials) {
  const std::string m = "/materials/0";
  EXPECT_THAT(spoilt(m + "/pbrMetallicRoughness/baseColorFactor", {1, 1}), HasSubstr("baseColorFactor"));
  EXPECT_THAT(spoilt(m + "/emissiveFactor", {1, 1, 1, 1}), HasSubstr("emissiveFactor"));
  EXPECT_THAT(spoilt(m + "/emissiveFactor", {1, -1, 1}), HasSubstr("emits less than nothing"));
  EXPECT_THAT(spoilt(m, {{"emissiveFactor", {1e300, 1, 1}},
                         {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 1e300}}}}}}),
              HasSubstr("not finite"));
  EXPECT_THAT(spoilt(m + "/pbrMetallicRoughness/baseColorTexture/index", 9), HasSubstr("texture 9 does not exist"));
  EXPECT_THAT(spoilt(m + "/pbrMetallicRoughness/baseColorTexture/texCoord", -2), HasSubstr("texCoord"));
  EXPECT_THAT(spoilt(m + "/pbrMetallicRoughness/baseColorTexture/extensions",
                     {{"KHR_texture_transform", {{"scale", {1e20, 1}}}}}),
              HasSubstr("KHR_texture_transform"));
  EXPECT_THAT(spoilt("/textures/0/source", 9), HasSubstr("image 9 does not exist"));
  EXPECT_THAT(without("/textures/0", "source"), HasSubstr("texture 0: has no image"));
}

TEST(GltfHostile, Images) {
  const auto with = [](const std::string& bytes) {
    Gltf file = good();
    file.json["images"][0] = {{"bufferView", file.add_view(bytes)}, {"mimeType", "image/png"}, {"name", "wood"}};
    return message_of(file.text());
  };
  const std::string png = PngBytes::make(2, 2, "abcdefghijkl");
  EXPECT_THAT(with("GIF89a"), HasSubstr("image 0 ('wood') is neither PNG nor JPEG"));
  EXPECT_THAT(with(png.substr(0, 20)), HasSubstr("neither PNG nor JPEG"));
  EXPECT_THAT(with(png.substr(0, 40)), HasSubstr("image 0 ('wood') cannot be decoded"));
  EXPECT_THAT(with(PngBytes::make(0, 2, "abc")), HasSubstr("image 0 ('wood')"));
  EXPECT_THAT(with(PngBytes::make(1u << 16, 1, "abc")), HasSubstr("65536 x 1 texels is too large"));
  EXPECT_THAT(with(PngBytes::make(0xffffffff, 0xffffffff, "abc")), HasSubstr("too large"));
  EXPECT_THAT(with(PngBytes::make(30000, 30000, "abc")), HasSubstr("30000 x 30000 texels is too large"));
  const std::string jpeg("\xff\xd8\xff\xe0\x00\x04zz\xff\xc0\x00\x11\x08\xff\xff\xff\xff\x03", 18);
  EXPECT_THAT(with(jpeg), HasSubstr("65535 x 65535 texels is too large"));
  EXPECT_THAT(with(std::string("\xff\xd8\xff\xe0\x00\x00zz", 8)), HasSubstr("neither PNG nor JPEG"));
  EXPECT_THAT(spoilt("/images/0/bufferView", 99), HasSubstr("bufferView"));
  EXPECT_THAT(spoilt("/images/0", json::object()), HasSubstr("image"));
  EXPECT_THAT(spoilt("/images/0", 4), HasSubstr("image"));
  EXPECT_THAT(spoilt("/images/0", {{"uri", "none.png"}}), HasSubstr("image 0 ('none.png') cannot be read"));
}

TEST(GltfHostile, AllTexturesTogetherAreBounded) {
  Gltf file = good();
  // Each claims the most that is allowed; the second is refused by its header. The first cannot be decoded either, so
  // it comes second here.
  const std::string large = PngBytes::make(8192, 8192, "abc");
  file.json["images"][0]["bufferView"] = file.add_view(large);
  EXPECT_THAT(message_of(file.text()), HasSubstr("cannot be decoded"));
  Gltf two = good();
  two.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", two.add_texture(large)}}}}}});
  two.add_triangle(json::object(), 1);
  EXPECT_THAT(message_of(two.text()), HasSubstr("8192 x 8192 texels is too large (all textures together"));
}

TEST(GltfHostile, Cameras) {
  const auto with = [](const json& camera, const json& node = json::object()) {
    Gltf file = good();
    file.add("cameras", camera);
    json with_camera = node;
    with_camera["camera"] = 0;
    file.add_root(with_camera);
    return message_of(file.text());
  };
  const json perspective{{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 1}}}};
  json wide = perspective;
  wide["perspective"]["yfov"] = 4;
  EXPECT_THAT(with(wide), HasSubstr("camera 0: yfov is 4"));
  EXPECT_THAT(with(perspective, {{"scale", {0, 0, 0}}}), HasSubstr("camera 0"));
  EXPECT_THAT(with({{"type", "pinhole"}}), HasSubstr("pinhole"));
  EXPECT_THAT(spoilt("/nodes/0/camera", 3), HasSubstr("camera 3 does not exist"));
}

TEST(GltfHostile, DeepAndWideJson) {
  const std::string deep(100000, '[');
  EXPECT_THAT(message_of(R"({"asset": {"version": "2.0"}, "extras": )" + deep), HasSubstr("nested too deep"));
  std::string wide = R"({"asset": {"version": "2.0"}, "nodes": [{})";
  wide.reserve(9000000);
  for (int i = 0; i < 2100000; ++i) wide += ",{}";
  EXPECT_THAT(message_of(wide + "]}"), HasSubstr("more JSON values"));
}

TEST(GltfHostile, WrongTypesEverywhere) {
  // Each value of the good file replaced by values of other types, one at a time: an error or a scene, nothing else.
  const Gltf file = good();
  const json flat = file.json.flatten();
  int read = 0, refused = 0;
  for (const auto& [pointer, value] : flat.items()) {
    for (const json& other : {json(nullptr), json(-1), json(1e308), json("x"), json::array(), json::object(),
                              json(true), json(4000000000u)}) {
      Gltf spoilt_file = file;
      spoilt_file.json[json::json_pointer(pointer)] = other;
      for (const std::string& bytes : {spoilt_file.text(), spoilt_file.glb()}) {
        try {
          (void)read_gltf(bytes, "folder/room.gltf");
          ++read;
        } catch (const Error& error) {
          EXPECT_EQ(error.kind(), ErrorKind::input);
          ++refused;
        }
      }
    }
  }
  EXPECT_GT(read, 20);  // names, hints and optional values
  EXPECT_GT(refused, 100);
}

TEST(GltfHostile, FlippedBytes) {
  const std::string glb = good().glb();
  std::mt19937 random(1);
  for (int i = 0; i < 3000; ++i) {
    std::string bytes = glb;
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    try {
      const Scene scene = read_gltf(bytes, "a.glb");
      for (const Triangle& t : scene.triangles) {
        for (const std::uint32_t v : t.vertex) {
          ASSERT_LT(v, scene.positions.size());
          ASSERT_TRUE(finite(scene.positions[v]));
        }
      }
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
    }
  }
}

}  // namespace
}  // namespace interflect
