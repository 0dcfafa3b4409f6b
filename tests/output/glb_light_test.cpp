// What a GLB file says of light beyond its colours at the vertices: light groups and lightmaps.
#include <gmock/gmock.h>

#include <cmath>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/lightmap.h"
#include "interflect/output/tone.h"
#include "output/glb_read.h"
#include "output/sample_scene.h"

namespace interflect {
namespace {

using test::glb_json;
using test::load_glb;
using test::Sample;
using test::TemporaryFolder;
using test::Values;
using test::values;

using Corners = std::array<test::GlbCorner, 3>;

Values floats(const tinygltf::Model& model, const tinygltf::Primitive& primitive, const std::string& name, int type) {
  return values(model, primitive.attributes.at(name), TINYGLTF_COMPONENT_TYPE_FLOAT, type);
}

/// Two light groups, which differ from place to place.
struct TwoGroups : Sample {
  TwoGroups() {
    solution.lights.names = {"sun \"\x01\xFF", "lamp"};
    solution.lit.assign(2, solution.radiosity);
    for (std::size_t i = 0; i < mesh.size(); ++i) {
      const double share = 0.5 + 0.1 * std::sin(3 * mesh.centroid[i].x);
      for (std::size_t c = 0; c < 3; ++c) {
        solution.lit[0][i][c] *= share;
        solution.lit[1][i][c] *= 1 - share;
      }
    }
  }
};

TEST(GlbLightTest, EveryLightGroupIsAnAttribute) {
  const TemporaryFolder folder;
  const TwoGroups lit;
  const Lightmap lightmap = bake_lightmap(lit.solution, make_atlas(lit.mesh, {128, 2, {}}));
  for (const bool mapped : {false, true}) {
    write_glb(lit.solution, folder / "m.glb", mapped ? &lightmap : nullptr);
    const auto extras = glb_json(read_file(folder / "m.glb"))["scenes"][0]["extras"];
    EXPECT_EQ(extras["interflect_light_groups"], nlohmann::json::array({"sun \"\x01\uFFFD", "lamp"}));
    const tinygltf::Model model = load_glb(folder / "m.glb");
    const std::array corners{corner_radiosities(lit.mesh, lit.solution.lit[0]),
                             corner_radiosities(lit.mesh, lit.solution.lit[1])};
    test::for_triangles(lit.solution, model,
                        [&](const tinygltf::Primitive& primitive, std::uint32_t i, const Corners& corner) {
                          EXPECT_FALSE(primitive.attributes.contains("_GROUP_2"));
                          const Values all = floats(model, primitive, "_RADIOSITY", TINYGLTF_TYPE_VEC3);
                          const std::array groups{floats(model, primitive, "_GROUP_0", TINYGLTF_TYPE_VEC3),
                                                  floats(model, primitive, "_GROUP_1", TINYGLTF_TYPE_VEC3)};
                          for (std::size_t k = 0; k < 3; ++k) {
                            for (std::size_t c = 0; c < 3; ++c) {
                              const std::size_t at = 3 * corner[k].index + c;
                              for (std::size_t g = 0; g < 2; ++g) {
                                ASSERT_NEAR(groups[g].at<float>(at) / corner[k].mean(corners[g][i], c), 1, 1e-5);
                              }
                              const float sum = groups[0].at<float>(at) + groups[1].at<float>(at);
                              ASSERT_NEAR(sum / all.at<float>(at), 1, 1e-6);
                            }
                          }
                        });
  }
}

TEST(GlbLightTest, WithoutGroupsThereAreNone) {
  const TemporaryFolder folder;
  const Sample lit;
  write_glb(lit.solution, folder / "m.glb");
  const auto json = glb_json(read_file(folder / "m.glb"));
  EXPECT_FALSE(json["scenes"][0]["extras"].contains("interflect_light_groups"));
  EXPECT_FALSE(json["meshes"][0]["primitives"][0]["attributes"].contains("_GROUP_0"));
  EXPECT_FALSE(json.contains("textures"));
}

TEST(GlbLightTest, GroupsWithoutNamesOrPatchesAreRefused) {
  const TemporaryFolder folder;
  TwoGroups unnamed, shorter;
  unnamed.solution.lights.names.pop_back();
  shorter.solution.lit[1].pop_back();
  EXPECT_THROW(write_glb(unnamed.solution, folder / "m.glb"), Error);
  EXPECT_THROW(write_glb(shorter.solution, folder / "m.glb"), Error);
  EXPECT_FALSE(std::filesystem::exists(folder / "m.glb"));
}

struct Shown {
  std::size_t right = 0, wrong = 0;
};

/// The embedded image, looked up where TEXCOORD_1 says, against the patches' interpolated radiosity: texels in patches
/// whose three bytes are those of the radiosity to one unit.
Shown shown_by(const Sample& lit, const std::filesystem::path& path) {
  const double scale = glb_json(read_file(path))["scenes"][0]["extras"]["interflect_color_scale"];
  const tinygltf::Model model = load_glb(path);
  const auto& texture = model.materials.at(0).pbrMetallicRoughness.baseColorTexture;
  EXPECT_EQ(texture.texCoord, 1);
  const auto source = model.textures.at(static_cast<std::size_t>(texture.index)).source;
  const auto& image = model.images.at(static_cast<std::size_t>(source));
  EXPECT_EQ(image.bits, 8);
  const auto channels = static_cast<std::size_t>(image.component);
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  Shown shown;
  test::for_triangles(
      lit.solution, model, [&](const tinygltf::Primitive& primitive, std::uint32_t i, const Corners& corner) {
        EXPECT_FALSE(primitive.attributes.contains("COLOR_0"));  // glTF would multiply
        EXPECT_EQ(primitive.attributes.at("TEXCOORD_0"), primitive.attributes.at("TEXCOORD_1"));
        const Values uv = floats(model, primitive, "TEXCOORD_1", TINYGLTF_TYPE_VEC2);
        std::array<std::array<double, 2>, 3> t{};
        for (std::size_t k = 0; k < 3; ++k) {
          t[k] = {uv.at<float>(2 * corner[k].index) * double(image.width),
                  uv.at<float>(2 * corner[k].index + 1) * double(image.height)};
        }
        const auto area = [](const auto& a, const auto& b, const auto& c) {
          return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        };
        const double whole = area(t[0], t[1], t[2]);
        for (int y = int(std::min({t[0][1], t[1][1], t[2][1]})); y <= int(std::max({t[0][1], t[1][1], t[2][1]})); ++y) {
          for (int x = int(std::min({t[0][0], t[1][0], t[2][0]})); x <= int(std::max({t[0][0], t[1][0], t[2][0]}));
               ++x) {
            const std::array<double, 2> p{x + 0.5, y + 0.5};
            const std::array<double, 3> w{area(p, t[1], t[2]) / whole, area(t[0], p, t[2]) / whole,
                                          area(t[0], t[1], p) / whole};
            if (*std::min_element(w.begin(), w.end()) < 1e-4) continue;  // the file's single precision at the rims
            Rgb b{};
            for (std::size_t c = 0; c < 3; ++c) {
              for (std::size_t k = 0; k < 3; ++k) b[c] += scale * w[k] * corner[k].mean(corners[i], c);
            }
            b = tone_map(b, ToneMap::linear);
            bool right = true;
            for (std::size_t c = 0; c < 3; ++c) {
              const int is =
                  image.image.at((std::size_t(y) * std::size_t(image.width) + std::size_t(x)) * channels + c);
              right = right && std::abs(is - srgb_byte(b[c])) <= 1;
            }
            ++(right ? shown.right : shown.wrong);
          }
        }
      });
  return shown;
}

TEST(GlbLightTest, TheEmbeddedLightmapShowsThePatchesRadiosity) {
  const TemporaryFolder folder;
  const Sample lit;
  Lightmap lightmap = bake_lightmap(lit.solution, make_atlas(lit.mesh, {128, 2, {}}));
  write_glb(lit.solution, folder / "m.glb", &lightmap);
  const auto json = glb_json(read_file(folder / "m.glb"));
  EXPECT_EQ(json["scenes"][0]["extras"]["interflect_lightmap"],
            nlohmann::json({{"size", 128}, {"texels_per_unit", lightmap.atlas.density}, {"padding", 2}}));
  EXPECT_EQ(json["images"][0]["mimeType"], "image/png");
  const Shown shown = shown_by(lit, folder / "m.glb");
  EXPECT_EQ(shown.wrong, 0U);
  EXPECT_GT(shown.right, 4000U);
  std::swap(lightmap.atlas.places[3], lightmap.atlas.places[11]);  // the twin: charts that changed places
  write_glb(lit.solution, folder / "m.glb", &lightmap);
  EXPECT_GT(shown_by(lit, folder / "m.glb").wrong, 50U);
}

}  // namespace
}  // namespace interflect
