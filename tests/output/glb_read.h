#pragma once

#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "interflect/output/output.h"

namespace interflect::test {

inline float float_at(const std::string& bytes, std::size_t at) {
  std::uint32_t bits = 0;
  for (std::size_t b = 4; b-- > 0;) bits = 256 * bits + static_cast<unsigned char>(bytes[at + b]);
  return std::bit_cast<float>(bits);
}
inline std::uint32_t uint_at(const std::string& bytes, std::size_t at) {
  return std::bit_cast<std::uint32_t>(float_at(bytes, at));
}

/// The JSON chunk of a GLB file; checks the container.
inline nlohmann::json glb_json(const std::string& bytes) {
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(uint_at(bytes, 4), 2U);
  EXPECT_EQ(uint_at(bytes, 8), bytes.size());
  const std::size_t length = uint_at(bytes, 12);
  EXPECT_EQ(length % 4, 0U);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  const std::size_t binary = 20 + length;
  EXPECT_EQ(uint_at(bytes, binary) % 4, 0U);
  EXPECT_EQ(bytes.substr(binary + 4, 4), std::string("BIN\0", 4));
  EXPECT_EQ(binary + 8 + uint_at(bytes, binary), bytes.size());
  return nlohmann::json::parse(bytes.substr(20, length));
}

inline tinygltf::Model load_glb(const std::filesystem::path& path) {
  tinygltf::TinyGLTF loader;
  tinygltf::Model model;
  std::string error, warning;
  EXPECT_TRUE(loader.LoadBinaryFromFile(&model, &error, &warning, path.string())) << error;
  EXPECT_EQ(error + warning, "");
  return model;
}

struct Values {
  std::size_t count = 0;
  const unsigned char* bytes = nullptr;
  template <class T>
  [[nodiscard]] T at(std::size_t k) const {
    T value;
    std::memcpy(&value, bytes + k * sizeof(T), sizeof(T));
    return value;
  }
};
inline Values values(const tinygltf::Model& model, int index, int component, int type) {
  const auto& accessor = model.accessors.at(static_cast<std::size_t>(index));
  EXPECT_EQ(accessor.componentType, component);
  EXPECT_EQ(accessor.type, type);
  const auto& view = model.bufferViews.at(static_cast<std::size_t>(accessor.bufferView));
  const auto& data = model.buffers.at(static_cast<std::size_t>(view.buffer)).data;
  const std::size_t size =
      4U * static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type)));
  EXPECT_EQ(view.byteLength, accessor.count * size);
  EXPECT_LE(view.byteOffset + view.byteLength, data.size());
  EXPECT_EQ(view.byteOffset % 4, 0U);
  return {accessor.count, data.data() + view.byteOffset};
}

/// A corner of a triangle in a file: its index, and its weights of the three corners of the patch in which it lies.
struct GlbCorner {
  std::size_t index = 0;
  std::array<double, 3> weights{};
  /// A value that is linear over the patch.
  [[nodiscard]] double mean(const std::array<Rgb, 3>& corners, std::size_t c) const {
    return weights[0] * corners[0][c] + weights[1] * corners[1][c] + weights[2] * corners[2][c];
  }
};

/// visit(primitive, patch, three corners) for each triangle of a GLB file: those of a patch follow one another and fill
/// it, patches are in order within a group.
template <class Visit>
void for_triangles(const Solution& solution, const tinygltf::Model& model, const Visit& visit) {
  const PatchMesh& mesh = *solution.mesh;
  std::size_t patches = 0;
  for (const auto& node : model.nodes) {
    const auto& primitive = model.meshes.at(static_cast<std::size_t>(node.mesh)).primitives.at(0);
    const Values index = values(model, primitive.indices, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT, TINYGLTF_TYPE_SCALAR);
    const Values position =
        values(model, primitive.attributes.at("POSITION"), TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3);
    std::size_t k = 0;
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      if (solution.grouping.names[solution.grouping.of_surface[mesh.surface[i]]] != node.name) continue;
      ++patches;
      const auto t = mesh.triangle(i);
      const auto share = [&](Vec3 a, Vec3 b, Vec3 c) {
        return dot(cross(b - a, c - a), mesh.normal[i]) / (2 * mesh.area[i]);
      };
      for (double filled = 0; filled < 1 - 1e-5;) {
        ASSERT_LE(k + 3, index.count);
        std::array<GlbCorner, 3> corners;
        std::array<Vec3, 3> at{};
        for (std::size_t c = 0; c < 3; ++c, ++k) {
          const std::size_t v = index.at<std::uint32_t>(k);
          ASSERT_LT(v, position.count);
          at[c] = {position.at<float>(3 * v), position.at<float>(3 * v + 1), position.at<float>(3 * v + 2)};
          corners[c] = {v, {share(at[c], t[1], t[2]), share(t[0], at[c], t[2]), share(t[0], t[1], at[c])}};
          for (const double w : corners[c].weights) ASSERT_GT(w, -1e-4);  // in the patch
        }
        const double area = share(at[0], at[1], at[2]);
        ASSERT_GT(area, 1e-6);  // its front is the patch's
        filled += area;
        ASSERT_LT(filled, 1 + 1e-4);
        visit(primitive, i, corners);
      }
    }
    EXPECT_EQ(k, index.count);
  }
  EXPECT_EQ(patches, mesh.size());
}

}  // namespace interflect::test
