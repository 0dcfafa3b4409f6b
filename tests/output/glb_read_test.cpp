// A solved GLB comes back as what was written, and damage is named.
#include <gmock/gmock.h>

#include <cstring>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <numeric>

#include "interflect/base/error.h"
#include "interflect/output/lit_mesh.h"
#include "interflect/output/renderer.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;
using test::TemporaryFolder;
using ::testing::HasSubstr;

/// A box with a lamp below its ceiling; radiosities that differ everywhere.
std::unique_ptr<Lit> room() {
  SceneBuilder s;
  const auto wall = s.material({0.5, 0.4, 0.3}), lamp = s.material({0.1, 0.1, 0.1}, {9, 8, 7});
  s.box("room", {wall, wall, wall, wall, wall, wall}, {0, 0, 0}, {3, 2.5, 4}, true);
  s.box("lamp", {lamp, lamp, lamp, lamp, lamp, lamp}, {1, 2, 1}, {2, 2.2, 2}, false);
  auto lit = std::make_unique<Lit>(s.scene(), 0.3);
  for (std::size_t i = 0; i < lit->mesh.size(); ++i) {
    const Vec3 p = lit->mesh.centroid[i];
    const double e = lit->mesh.emittance[i][0];
    lit->solution.radiosity[i] = {0.2 + 0.1 * p.x + e, 0.3 + 0.1 * p.y + e, 0.1 + 0.05 * p.z + e};
  }
  return lit;
}

PictureOptions view() {
  PictureOptions options;
  options.camera = Camera{{0.3, 1.2, 0.3}, {2, 1.5, 2.5}, {0, 1, 0}, 1.1};
  options.width = 160, options.height = 120;
  return options;
}

TEST(SolvedGlb, GivesThePictureThatTheSolutionGives) {
  const TemporaryFolder folder;
  const auto lit = room();
  write_glb(lit->solution, folder / "room.glb");
  const auto back = read_solved_glb(folder / "room.glb");
  ASSERT_TRUE(back);
  EXPECT_GT(back->mesh.size(), lit->mesh.size()) << "patches are cut where finer ones meet them";
  const auto whole = [](const PatchMesh& mesh) { return std::accumulate(mesh.area.begin(), mesh.area.end(), 0.0); };
  EXPECT_NEAR(whole(back->mesh), whole(lit->mesh), 1e-5 * whole(lit->mesh));
  const Picture before = render(lit->solution, view()), after = Renderer(*back).render(view());
  // Lamps do not count for the exposure: so the file must know them.
  EXPECT_NEAR(after.exposure, before.exposure, 1e-3 * before.exposure);
  std::size_t different = 0;
  for (std::size_t k = 0; k < before.pixels.size(); ++k) {
    different += std::abs(before.pixels[k] - after.pixels[k]) > 1e-3F ? 1 : 0;
  }
  EXPECT_LE(different, before.pixels.size() / 1000);  // a float's rounding may move an edge
}

/// The bytes of the solved file, changed, and the line that reading it gives.
std::string error_of(const std::function<void(std::string&)>& damage) {
  const TemporaryFolder folder;
  write_glb(room()->solution, folder / "room.glb");
  std::ifstream in(folder / "room.glb", std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), {});
  damage(bytes);
  std::ofstream(folder / "bad.glb", std::ios::binary) << bytes;
  try {
    return read_solved_glb(folder / "bad.glb") ? "read" : "not ours";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
}

void replace(std::string& bytes, const std::string& from, const std::string& to) {
  ASSERT_EQ(from.size(), to.size());
  for (auto at = bytes.find(from); at != std::string::npos; at = bytes.find(from, at + 1))
    bytes.replace(at, from.size(), to);
}

TEST(SolvedGlb, DamageIsNamed) {
  EXPECT_EQ(error_of([](std::string&) {}), "read");
  EXPECT_THAT(error_of([](std::string& b) { replace(b, "\"_RADIOSITY\"", "\"_RADIOSITX\""); }),
              AllOf(HasSubstr("bad.glb"), HasSubstr("_RADIOSITY is missing")));
  // The file ends with the last primitive's _EMITTANCE and indices; a number in the middle of all is a radiosity or
  // position, and NaN is neither.
  EXPECT_THAT(error_of([](std::string& b) {
                for (std::size_t k = b.size() / 2 & ~std::size_t{3}; k < b.size() / 2 + 4000; ++k) b[k] = '\xff';
              }),
              HasSubstr("bad.glb"));
  EXPECT_THAT(error_of([](std::string& b) { b.resize(b.size() / 2); }), HasSubstr("truncated"));
  EXPECT_EQ(error_of([](std::string& b) {
              replace(b, "\"_RADIOSITY\"", "\"_RADIOSITX\"");
              replace(b, "\"Interflect\"", "\"Interflecx\"");
            }),
            "not ours");
}

using Json = nlohmann::json;

/// The solved file with a changed JSON chunk.
void rewrite(std::string& bytes, const std::function<void(Json&)>& change) {
  const auto number = [&](std::size_t at) {
    std::uint32_t n = 0;
    std::memcpy(&n, bytes.data() + at, 4);
    return n;
  };
  const auto put = [&](std::size_t at, std::size_t n) {
    const auto value = static_cast<std::uint32_t>(n);
    std::memcpy(bytes.data() + at, &value, 4);
  };
  Json json = Json::parse(bytes.substr(20, number(12)));
  change(json);
  std::string text = json.dump();
  text.append((4 - text.size() % 4) % 4, ' ');
  bytes.replace(20, number(12), text);
  put(8, bytes.size()), put(12, text.size());
}

TEST(SolvedGlb, AsksForNoMoreThanItHolds) {
  const auto repeated = [](std::size_t times) {
    return error_of([&](std::string& b) {
      rewrite(b, [&](Json& json) {
        Json& list = json["meshes"][0]["primitives"];
        const Json one = list[0];
        while (list.size() < times) list.push_back(one);
      });
    });
  };
  EXPECT_EQ(repeated(2), "read");
  EXPECT_THAT(repeated(100000), HasSubstr("more values than the file has bytes for"));
  // A sparse accessor needs no bytes for what it does not name.
  EXPECT_THAT(error_of([](std::string& b) {
                rewrite(b, [](Json& json) {
                  const Json& primitive = json["meshes"][0]["primitives"][0];
                  const auto view = json["accessors"][primitive["indices"].get<std::size_t>()]["bufferView"];
                  for (const char* name : {"POSITION", "_RADIOSITY"}) {
                    Json& accessor = json["accessors"][primitive["attributes"][name].get<std::size_t>()];
                    accessor["sparse"] = {{"count", 1},
                                          {"indices", {{"bufferView", view}, {"componentType", 5125}}},
                                          {"values", {{"bufferView", accessor["bufferView"]}}}};
                    accessor.erase("bufferView");
                    accessor["count"] = 1'000'000'000'000;
                  }
                });
              }),
              HasSubstr("more values than the file has bytes for"));
}

TEST(SolvedGlb, MustHaveAnArea) {
  EXPECT_THAT(error_of([](std::string& b) {
                rewrite(b, [](Json& json) {
                  for (const Json& mesh : json["meshes"]) {
                    json["accessors"][mesh["primitives"][0]["indices"].get<std::size_t>()]["count"] = 3;
                  }
                });
              }),
              "read");
  // One vertex three times.
  EXPECT_THAT(error_of([](std::string& b) {
                rewrite(b, [](Json& json) {
                  for (const Json& mesh : json["meshes"]) {
                    const Json& primitive = mesh["primitives"][0];
                    for (const auto& attribute : primitive["attributes"]) {
                      json["accessors"][attribute.get<std::size_t>()]["count"] = 1;
                    }
                    Json& indices = json["accessors"][primitive["indices"].get<std::size_t>()];
                    indices["count"] = 3, indices["componentType"] = 5121;
                    // The three bytes that follow the low one of the first index, which is small: zeros.
                    indices["byteOffset"] = 1;
                  }
                });
              }),
              HasSubstr("no patch has an area"));
}

}  // namespace
}  // namespace interflect
