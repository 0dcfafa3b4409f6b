#pragma once

#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

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

}  // namespace interflect::test
