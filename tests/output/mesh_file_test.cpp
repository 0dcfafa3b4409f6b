#include <gmock/gmock.h>
#include <tiny_gltf.h>

#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <set>
#include <sstream>

#include "interflect/base/file.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"
#include "interflect/output/tone.h"
#include "output/glb_read.h"
#include "output/programs.h"
#include "output/rooms.h"
#include "output/sample_scene.h"

namespace interflect {
namespace {

using test::float_at;
using test::glb_json;
using test::load_glb;
using test::Sample;
using test::TemporaryFolder;
using test::uint_at;
using test::Values;
using test::values;

struct PlyVertex {
  std::array<float, 3> position, normal, radiosity;
  std::array<std::uint8_t, 3> colour;
};
struct PlyFile {
  std::vector<PlyVertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> faces;
  double exposure = 0;
};

/// By the layout that output.h promises; anything left over or missing is a failure.
PlyFile parse_ply(const std::string& bytes) {
  const std::size_t end = bytes.find("end_header\n");
  EXPECT_NE(end, std::string::npos);
  const std::string header = bytes.substr(0, end);
  const std::string properties =
      "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float radiosity_r\nproperty float radiosity_g\nproperty float radiosity_b\n";
  EXPECT_TRUE(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_THAT(header, ::testing::HasSubstr(properties + "element face "));
  EXPECT_THAT(header, ::testing::EndsWith("property list uchar uint vertex_indices\n"));
  PlyFile ply;
  std::size_t vertices = 0, faces = 0;
  std::sscanf(header.c_str() + header.find("element vertex"), "element vertex %zu", &vertices);
  std::sscanf(header.c_str() + header.find("element face"), "element face %zu", &faces);
  std::sscanf(header.c_str() + header.find("sRGB of"), "sRGB of %lf", &ply.exposure);
  std::size_t at = end + 11;
  EXPECT_EQ(bytes.size(), at + 39 * vertices + 13 * faces);
  for (std::size_t v = 0; v < vertices; ++v, at += 39) {
    PlyVertex p{};
    for (std::size_t c = 0; c < 3; ++c) {
      p.position[c] = float_at(bytes, at + 4 * c);
      p.normal[c] = float_at(bytes, at + 12 + 4 * c);
      p.colour[c] = static_cast<std::uint8_t>(bytes[at + 24 + c]);
      p.radiosity[c] = float_at(bytes, at + 27 + 4 * c);
    }
    ply.vertices.push_back(p);
  }
  for (std::size_t f = 0; f < faces; ++f, at += 13) {
    EXPECT_EQ(bytes[at], 3);
    ply.faces.push_back({uint_at(bytes, at + 1), uint_at(bytes, at + 5), uint_at(bytes, at + 9)});
  }
  return ply;
}

TEST(PlyTest, HoldsTheSmoothMesh) {
  const TemporaryFolder folder;
  const Sample lit;
  write_ply(lit.solution, folder / "m.ply");
  const PlyFile ply = parse_ply(read_file(folder / "m.ply"));
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  ASSERT_EQ(ply.faces.size(), lit.mesh.size());
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const PlyVertex& v = ply.vertices.at(ply.faces[i][c]);
      const Vec3 p = lit.mesh.triangle(i)[c];
      EXPECT_EQ(v.position, (std::array<float, 3>{float(p.x), float(p.y), float(p.z)}));
      const Vec3 n{v.normal[0], v.normal[1], v.normal[2]};
      EXPECT_NEAR(length(n), 1, 1e-6);
      EXPECT_GT(dot(n, lit.mesh.normal[i]), 0.9);
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(v.radiosity[k], static_cast<float>(corners[i][c][k]));
      }
      const Rgb b = corners[i][c];
      const Rgb shown = tone_map({b[0] * ply.exposure, b[1] * ply.exposure, b[2] * ply.exposure}, ToneMap::linear);
      for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(v.colour[k], srgb_byte(shown[k]));
    }
  }
  // Shared where the surface is smooth, split where it is not: fewer than three per patch, more than the mesh has.
  EXPECT_GT(ply.vertices.size(), lit.mesh.vertices.size());
  EXPECT_LT(ply.vertices.size(), 3 * lit.mesh.size() / 2);
}

TEST(PlyTest, AssimpReadsIt) {
  const TemporaryFolder folder;
  const Sample lit;
  write_ply(lit.solution, folder / "m.ply");
  const auto output = test::run_program("assimp", "info", folder / "m.ply", "--raw");
  if (!output) GTEST_SKIP() << "assimp is not installed (package assimp-utils)";
  EXPECT_EQ(test::number_after(*output, "Vertices"), static_cast<long>(smooth_mesh(lit.mesh).size())) << *output;
  EXPECT_EQ(test::number_after(*output, "Faces"), static_cast<long>(lit.mesh.size())) << *output;
}

/// The colours of the vertices as assimp understands them: lines "x y z nx ny nz red green blue alpha" of the ASCII PLY
/// that it makes of a file. Nothing when assimp is not there.
std::optional<std::vector<std::array<double, 10>>> assimp_vertices(const std::filesystem::path& file,
                                                                   const std::filesystem::path& converted) {
  const auto output = test::run_program("assimp", "export '" + file.string() + "'", converted);
  if (!output) return std::nullopt;
  std::istringstream text(read_file(converted));
  std::string line;
  while (std::getline(text, line) && line != "end_header") continue;
  std::vector<std::array<double, 10>> vertices;
  while (std::getline(text, line)) {
    std::istringstream numbers(line);
    std::array<double, 10> v{};
    for (double& x : v) numbers >> x;
    if (!numbers) break;  // the faces
    vertices.push_back(v);
  }
  return vertices;
}

TEST(PlyTest, AssimpSeesTheColours) {
  const TemporaryFolder folder;
  const Sample lit;
  write_ply(lit.solution, folder / "m.ply");
  const auto seen = assimp_vertices(folder / "m.ply", folder / "a.ply");
  if (!seen) GTEST_SKIP() << "assimp is not installed (package assimp-utils)";
  const PlyFile ply = parse_ply(read_file(folder / "m.ply"));
  ASSERT_EQ(seen->size(), ply.vertices.size());
  for (std::size_t v = 0; v < seen->size(); ++v) {
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR((*seen)[v][c], ply.vertices[v].position[c], 1e-6);
      EXPECT_NEAR((*seen)[v][3 + c], ply.vertices[v].normal[c], 1e-6);
      EXPECT_EQ((*seen)[v][6 + c], ply.vertices[v].colour[c]);
    }
  }
}

TEST(GlbTest, HoldsTheSmoothMeshByGroups) {
  const TemporaryFolder folder;
  const Sample lit;
  write_glb(lit.solution, folder / "m.glb");
  const auto json = glb_json(read_file(folder / "m.glb"));
  const double scale = json["scenes"][0]["extras"]["interflect_color_scale"];
  EXPECT_TRUE(json["materials"][0]["extensions"].contains("KHR_materials_unlit"));
  const tinygltf::Model model = load_glb(folder / "m.glb");
  EXPECT_EQ(model.asset.version, "2.0");
  EXPECT_EQ(model.asset.generator, "Interflect");
  ASSERT_EQ(model.nodes.size(), 3U);
  EXPECT_EQ(model.scenes[0].nodes.size(), 3U);
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  std::set<std::string> names;
  for (const auto& node : model.nodes) names.insert(node.name);
  test::for_triangles(
      lit.solution, model, [&](const tinygltf::Primitive& primitive, std::uint32_t i, const auto& corner) {
        const auto attribute = [&](const char* name, int type = TINYGLTF_TYPE_VEC3) {
          return values(model, primitive.attributes.at(name), TINYGLTF_COMPONENT_TYPE_FLOAT, type);
        };
        const Values position = attribute("POSITION"), normal = attribute("NORMAL"),
                     colour = attribute("COLOR_0", TINYGLTF_TYPE_VEC4), linear = attribute("_RADIOSITY");
        EXPECT_EQ(linear.count, position.count);
        const auto& bounds = model.accessors[static_cast<std::size_t>(primitive.attributes.at("POSITION"))];
        for (const test::GlbCorner& at : corner) {
          const std::size_t v = at.index;
          Rgb b{};
          for (std::size_t c = 0; c < 3; ++c) b[c] = at.mean(corners[i], c);
          const Rgb shown = tone_map({scale * b[0], scale * b[1], scale * b[2]}, ToneMap::linear);
          for (std::size_t a = 0; a < 3; ++a) {
            EXPECT_GE(position.at<float>(3 * v + a), bounds.minValues[a]);
            EXPECT_LE(position.at<float>(3 * v + a), bounds.maxValues[a]);
            EXPECT_NEAR(linear.at<float>(3 * v + a) / b[a], 1, 1e-5);
            EXPECT_NEAR(colour.at<float>(4 * v + a) / shown[a], 1, 1e-5);
            EXPECT_LE(colour.at<float>(4 * v + a), 1);  // glTF 2.0, 3.7.2.1
          }
          const Vec3 n{normal.at<float>(3 * v), normal.at<float>(3 * v + 1), normal.at<float>(3 * v + 2)};
          EXPECT_NEAR(length(n), 1, 1e-6);
          EXPECT_GT(dot(n, lit.mesh.normal[i]), 0.9);
          EXPECT_EQ(colour.at<float>(4 * v + 3), 1);
        }
      });
  EXPECT_EQ(names, (std::set<std::string>{"walls", "lamp", "barrel"}));
}

TEST(GlbTest, ColoursAreTheRadiositiesWhereTheseFit) {
  const TemporaryFolder folder;
  const Sample fits(1.0 / 20), bright(1), dark(1e-5);
  const auto scale = [&](const Solution& solution) -> double {
    write_glb(solution, folder / "m.glb");
    return glb_json(read_file(folder / "m.glb"))["scenes"][0]["extras"]["interflect_color_scale"];
  };
  EXPECT_EQ(scale(fits.solution), 1);
  EXPECT_LT(scale(bright.solution), 1);
  EXPECT_GT(scale(dark.solution), 1000);
}

TEST(GlbTest, AssimpReadsIt) {
  const TemporaryFolder folder;
  const Sample lit;
  write_glb(lit.solution, folder / "m.glb");
  const auto output = test::run_program("assimp", "info", folder / "m.glb", "--raw");
  if (!output) GTEST_SKIP() << "assimp is not installed (package assimp-utils)";
  long vertices = 0;
  for (const auto& mesh : load_glb(folder / "m.glb").accessors) {
    if (!mesh.minValues.empty()) vertices += static_cast<long>(mesh.count);
  }
  EXPECT_EQ(test::number_after(*output, "Vertices"), vertices) << *output;
  long faces = 0;
  test::for_triangles(lit.solution, load_glb(folder / "m.glb"),
                      [&](const auto&, std::uint32_t, const auto&) { ++faces; });
  EXPECT_EQ(test::number_after(*output, "Faces"), faces) << *output;
  EXPECT_EQ(test::number_after(*output, "Meshes"), 3) << *output;
  for (const char* name : {"walls", "lamp", "barrel"}) {
    EXPECT_THAT(*output, ::testing::HasSubstr(name));
  }
}

TEST(GlbTest, AssimpSeesTheColours) {
  const TemporaryFolder folder;
  const Sample lit;
  write_glb(lit.solution, folder / "m.glb");
  const auto seen = assimp_vertices(folder / "m.glb", folder / "a.ply");
  if (!seen) GTEST_SKIP() << "assimp is not installed (package assimp-utils)";
  const tinygltf::Model model = load_glb(folder / "m.glb");
  std::size_t at = 0;
  for (const auto& mesh : model.meshes) {
    const Values colour =
        values(model, mesh.primitives[0].attributes.at("COLOR_0"), TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC4);
    for (std::size_t v = 0; v < colour.count; ++v, ++at) {
      ASSERT_LT(at, seen->size());
      for (std::size_t c = 0; c < 4; ++c) EXPECT_NEAR((*seen)[at][6 + c], 255 * colour.at<float>(4 * v + c), 1);
    }
  }
  EXPECT_EQ(at, seen->size());
}

TEST(GlbTest, SurvivesHostileNamesAndValues) {
  const TemporaryFolder folder;
  Sample lit(1, "L\"\\\n\x01 \xFF \xC0 Stra\u00DFe </script>");
  lit.solution.radiosity[0] = {std::numeric_limits<double>::quiet_NaN(), 1e300, -1};
  lit.solution.radiosity[1] = {std::numeric_limits<double>::infinity(), 1, 1};
  for (auto& b : lit.solution.radiosity) b[2] = 1e300;
  write_glb(lit.solution, folder / "m.glb");
  write_ply(lit.solution, folder / "m.ply");
  const auto json = glb_json(read_file(folder / "m.glb"));
  std::vector<std::string> names;
  for (const auto& node : json["nodes"]) names.push_back(node["name"]);
  EXPECT_THAT(names, ::testing::Contains("L\"\\\n\x01 \uFFFD \uFFFD Stra\u00DFe </script>"));
  const tinygltf::Model model = load_glb(folder / "m.glb");
  for (const auto& accessor : model.accessors) {
    if (accessor.type != TINYGLTF_TYPE_VEC3) continue;
    const auto index = static_cast<int>(&accessor - model.accessors.data());
    const Values v = values(model, index, TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3);
    for (std::size_t k = 0; k < 3 * v.count; ++k) ASSERT_TRUE(std::isfinite(v.at<float>(k)));
  }
  for (const PlyVertex& v : parse_ply(read_file(folder / "m.ply")).vertices) {
    for (const float b : v.radiosity) ASSERT_TRUE(std::isfinite(b));
  }
}

}  // namespace
}  // namespace interflect
