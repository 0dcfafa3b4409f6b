#pragma once

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace interflect::testing {

inline std::string base64(std::string_view bytes) {
  constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t v = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      v = v << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (std::size_t k = 0; k < 4; ++k) out += i + k > bytes.size() ? '=' : digits[v >> (18 - 6 * k) & 63];
  }
  return out;
}

template <class T>
std::string raw(const std::vector<T>& values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  if (!values.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

/// A glTF file in the making: `json` is free to be spoilt before text() or glb() is called.
class Gltf {
 public:
  nlohmann::json json = {{"asset", {{"version", "2.0"}}}};

  int add_view(std::string_view bytes, int stride = 0) {
    binary_.resize((binary_.size() + 3) / 4 * 4);
    nlohmann::json view{{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes.size()}};
    if (stride != 0) view["byteStride"] = stride;
    binary_ += bytes;
    return add("bufferViews", view);
  }
  int add_accessor(std::string_view bytes, int component, std::size_t count, const std::string& type) {
    return add("accessors",
               {{"bufferView", add_view(bytes)}, {"componentType", component}, {"count", count}, {"type", type}});
  }
  int floats(const std::vector<float>& values, const std::string& type) {
    const std::size_t n = type == "VEC3" ? 3 : type == "VEC2" ? 2 : 1;
    return add_accessor(raw(values), 5126, values.size() / n, type);
  }
  template <class T>
  int indices(const std::vector<T>& values) {
    return add_accessor(raw(values), sizeof(T) == 1 ? 5121 : sizeof(T) == 2 ? 5123 : 5125, values.size(), "SCALAR");
  }
  /// Appends to a top-level list and returns the index.
  int add(const char* list, const nlohmann::json& element) {
    json[list].push_back(element);
    return static_cast<int>(json[list].size()) - 1;
  }
  int add_image(std::string_view bytes) {
    return add("images", {{"bufferView", add_view(bytes)}, {"mimeType", "image/png"}});
  }
  int add_texture(std::string_view bytes) { return add("textures", {{"source", add_image(bytes)}}); }
  int add_mesh(const nlohmann::json& primitive) {
    return add("meshes", {{"primitives", nlohmann::json::array({primitive})}});
  }
  /// A node in the scene.
  int add_root(const nlohmann::json& node) {
    const int index = add("nodes", node);
    json["scenes"][0]["nodes"].push_back(index);
    return index;
  }
  /// A triangle (0,0,0) (1,0,0) (0,1,0) under a root node; the node may have a transformation.
  int add_triangle(nlohmann::json node = nlohmann::json::object(), int material = -1) {
    nlohmann::json primitive{{"attributes",
                              {{"POSITION", floats({0, 0, 0, 1, 0, 0, 0, 1, 0}, "VEC3")},
                               {"TEXCOORD_0", floats({0, 0, 1, 0, 0, 1}, "VEC2")}}}};
    if (material >= 0) primitive["material"] = material;
    node["mesh"] = add_mesh(primitive);
    return add_root(node);
  }

  [[nodiscard]] std::string text() const {
    nlohmann::json all = json;
    if (!all.contains("buffers") && !binary_.empty()) {
      all["buffers"].push_back(
          {{"byteLength", binary_.size()}, {"uri", "data:application/octet-stream;base64," + base64(binary_)}});
    }
    return all.dump();
  }
  [[nodiscard]] std::string glb() const {
    nlohmann::json all = json;
    if (!all.contains("buffers")) all["buffers"].push_back({{"byteLength", binary_.size()}});
    std::string text = all.dump(), binary = binary_;
    text.resize((text.size() + 3) / 4 * 4, ' ');
    binary.resize((binary.size() + 3) / 4 * 4);
    const auto u32 = [](std::size_t v) { return raw(std::vector<std::uint32_t>{static_cast<std::uint32_t>(v)}); };
    return "glTF" + u32(2) + u32(28 + text.size() + binary.size()) + u32(text.size()) + "JSON" + text +
           u32(binary.size()) + std::string("BIN\0", 4) + binary;
  }

 private:
  std::string binary_;
};

/// A JPEG of one texel, sRGB 188 188 188 (made with stb_image_write).
inline const char* const grey_jpeg_base64 =
    "/9j/4AAQSkZJRgABAQAAAQABAAD/2wCEAAEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEB"
    "AQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEB"
    "AQEBAf/AABEIAAEAAQMBEQACEQEDEQH/xAGiAAABBQEBAQEBAQAAAAAAAAAAAQIDBAUGBwgJCgsQAAIBAwMCBAMFBQQEAAABfQEC"
    "AwAEEQUSITFBBhNRYQcicRQygZGhCCNCscEVUtHwJDNicoIJChYXGBkaJSYnKCkqNDU2Nzg5OkNERUZHSElKU1RVVldYWVpjZGVm"
    "Z2hpanN0dXZ3eHl6g4SFhoeIiYqSk5SVlpeYmZqio6Slpqeoqaqys7S1tre4ubrCw8TFxsfIycrS09TV1tfY2drh4uPk5ebn6Onq"
    "8fLz9PX29/j5+gEAAwEBAQEBAQEBAQAAAAAAAAECAwQFBgcICQoLEQACAQIEBAMEBwUEBAABAncAAQIDEQQFITEGEkFRB2FxEyIy"
    "gQgUQpGhscEJIzNS8BVictEKFiQ04SXxFxgZGiYnKCkqNTY3ODk6Q0RFRkdISUpTVFVWV1hZWmNkZWZnaGlqc3R1dnd4eXqCg4SF"
    "hoeIiYqSk5SVlpeYmZqio6Slpqeoqaqys7S1tre4ubrCw8TFxsfIycrS09TV1tfY2dri4+Tl5ufo6ery8/T19vf4+fr/2gAMAwEA"
    "AhEDEQA/AP3goA//2Q==";

}  // namespace interflect::testing
