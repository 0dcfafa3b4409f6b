#include "interflect/scene/gltf_material.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "interflect/base/error.h"
#include "interflect/scene/gltf_image.h"
#include "interflect/scene/scene_limits.h"

namespace interflect::gltf {

namespace {

const tinygltf::Value* extension(const tinygltf::ExtensionMap& extensions, const char* name, const char* key) {
  const auto found = extensions.find(name);
  if (found == extensions.end() || !found->second.IsObject() || !found->second.Has(key)) return nullptr;
  return &found->second.Get(key);
}

double number(const tinygltf::Value* value, double fallback) {
  return value != nullptr && value->IsNumber() ? value->GetNumberAsDouble() : fallback;
}

Vec2 pair(const tinygltf::Value* value, Vec2 fallback) {
  if (value == nullptr || !value->IsArray() || value->ArrayLen() != 2) return fallback;
  return {number(&value->Get(0), fallback.x), number(&value->Get(1), fallback.y)};
}

bool black(const Rgb& colour) {
  return colour == Rgb{};
}

}  // namespace

Vec2 TextureCoordinates::apply(Vec2 uv) const {
  const double u = uv.x * scale.x, v = uv.y * scale.y, c = std::cos(rotation), s = std::sin(rotation);
  return {c * u + s * v + offset.x, c * v - s * u + offset.y};
}

Error Materials::fail(const std::string& who, std::string_view cause) const {
  return input_error(document_.file, 0, fmt::format("{}: {}", who, cause));
}

const Materials::Entry& Materials::get(int index) {
  const auto found = known_.find(index);
  if (found != known_.end()) return found->second;
  if (index >= 0 && static_cast<std::size_t>(index) >= document_.model.materials.size()) {
    throw fail(fmt::format("material {}", index), "does not exist");
  }
  if (index >= 0) return known_[index] = convert(document_.model.materials[static_cast<std::size_t>(index)], index);
  Entry entry{static_cast<std::uint32_t>(scene_.materials.size()), {}};
  scene_.materials.push_back({.name = "default", .reflectance = {1, 1, 1}});
  return known_[-1] = entry;
}

Materials::Entry Materials::convert(const tinygltf::Material& material, int index) {
  Entry entry{static_cast<std::uint32_t>(scene_.materials.size()), {}};
  Material m;
  m.name = material.name.empty() ? fmt::format("material {}", index) : material.name.substr(0, max_scene_name);
  const std::string who = fmt::format("material {} ('{}')", index, m.name);
  m.two_sided = material.doubleSided;

  const auto& pbr = material.pbrMetallicRoughness;
  if (pbr.baseColorFactor.size() != 4 || material.emissiveFactor.size() != 3) throw fail(who, "a colour is incomplete");
  const double strength =
      number(extension(material.extensions, "KHR_materials_emissive_strength", "emissiveStrength"), 1);
  for (std::size_t c = 0; c < 3; ++c) {
    m.reflectance[c] = pbr.baseColorFactor[c];
    m.emittance[c] = material.emissiveFactor[c] * strength;
    if (!std::isfinite(m.reflectance[c]) || !std::isfinite(m.emittance[c])) throw fail(who, "a colour is not finite");
    if (m.emittance[c] < 0) throw fail(who, "emits less than nothing");
  }

  Texture reflectance, emittance;
  if (!black(m.reflectance)) reflectance = texture(pbr.baseColorTexture, who);
  if (!black(m.emittance)) emittance = texture(material.emissiveTexture, who);
  const bool two_mappings =
      reflectance.image >= 0 && emittance.image >= 0 && reflectance.coordinates != emittance.coordinates;
  if (two_mappings) {  // a triangle has room for one set of coordinates
    const Rgb average = mean(scene_.images[static_cast<std::size_t>(emittance.image)]);
    for (std::size_t c = 0; c < 3; ++c) m.emittance[c] *= average[c];
    emittance.image = -1;
    scene_.warnings.emplace_back(
        fail(who, "its two textures have different coordinates; the emissive one is averaged").what());
  }
  m.reflectance_image = reflectance.image;
  m.emittance_image = emittance.image;
  entry.coordinates = reflectance.image >= 0 ? reflectance.coordinates : emittance.coordinates;
  if (m.reflectance_image < 0 && m.emittance_image < 0) entry.coordinates.set = -1;
  scene_.materials.push_back(std::move(m));
  return entry;
}

Materials::Texture Materials::texture(const tinygltf::TextureInfo& info, const std::string& who) {
  if (info.index < 0) return {};
  if (static_cast<std::size_t>(info.index) >= document_.model.textures.size()) {
    throw fail(who, fmt::format("texture {} does not exist", info.index));
  }
  Texture texture;
  texture.image = image_of(document_.model.textures[static_cast<std::size_t>(info.index)].source,
                           fmt::format("texture {}", info.index));
  constexpr const char* transform = "KHR_texture_transform";
  TextureCoordinates& at = texture.coordinates;
  at.offset = pair(extension(info.extensions, transform, "offset"), at.offset);
  at.scale = pair(extension(info.extensions, transform, "scale"), at.scale);
  at.rotation = number(extension(info.extensions, transform, "rotation"), 0);
  const double set = number(extension(info.extensions, transform, "texCoord"), info.texCoord);
  if (!(set >= 0 && set <= 1000)) throw fail(who, "texCoord is not a small whole number");
  at.set = static_cast<int>(set);
  const double size = std::abs(at.offset.x) + std::abs(at.offset.y) + std::abs(at.scale.x) + std::abs(at.scale.y);
  if (!(size < 1e9) || !std::isfinite(at.rotation)) throw fail(who, "KHR_texture_transform is out of range");
  return texture;
}

int Materials::image_of(int index, const std::string& who) {
  if (index < 0 || static_cast<std::size_t>(index) >= document_.model.images.size()) {
    throw fail(who,
               index < 0 ? "has no image that glTF 2.0 itself knows" : fmt::format("image {} does not exist", index));
  }
  const auto [entry, added] = images_.try_emplace(index, static_cast<int>(scene_.images.size()));
  if (added) scene_.images.push_back(decode_image(document_, index, texels_left_));
  return entry->second;
}

}  // namespace interflect::gltf
