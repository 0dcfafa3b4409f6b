#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "interflect/base/error.h"
#include "interflect/scene/gltf_document.h"
#include "interflect/scene/gltf_image.h"
#include "interflect/scene/scene.h"

namespace interflect::gltf {

/// Where a textured material takes its texture coordinates from.
struct TextureCoordinates {
  int set = -1;  ///< n of TEXCOORD_n; -1: the material has no texture
  Vec2 offset{}, scale{1, 1};
  double rotation = 0;  ///< radians, counter-clockwise with v pointing down

  /// KHR_texture_transform: scale, then rotate, then move.
  [[nodiscard]] Vec2 apply(Vec2 uv) const;
  bool operator==(const TextureCoordinates&) const = default;
};

/// Turns glTF materials into Scene::materials and the textures that they use into Scene::images, on first use.
class Materials {
 public:
  struct Entry {
    std::uint32_t index = 0;  ///< into Scene::materials
    TextureCoordinates coordinates;
  };

  Materials(const Document& document, Scene& scene) : document_(document), scene_(scene) {}

  /// The material of glTF's index, -1 for glTF's default one (white). Throws an input Error naming it.
  [[nodiscard]] const Entry& get(int index);

 private:
  struct Texture {
    int image = -1;  ///< into Scene::images
    TextureCoordinates coordinates;
  };
  [[nodiscard]] Entry convert(const tinygltf::Material& material, int index);
  [[nodiscard]] Texture texture(const tinygltf::TextureInfo& info, const std::string& who);
  [[nodiscard]] int image_of(int index, const std::string& who);
  [[nodiscard]] Error fail(const std::string& who, std::string_view cause) const;

  const Document& document_;
  Scene& scene_;
  std::map<int, Entry> known_;
  std::map<int, int> images_;
  std::uint64_t texels_left_ = max_texels;
};

}  // namespace interflect::gltf
