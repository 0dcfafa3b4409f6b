#include "interflect/output/glb_asset.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/bytes.h"

namespace interflect {

namespace {

enum : int {
  array_buffer = 34962,
  element_array_buffer = 34963,
  type_float = 5126,
  type_uint = 5125,
  filter_linear = 9729,
  clamp_to_edge = 33071,
};

}  // namespace

GlbAsset::GlbAsset() {
  json_["asset"] = {{"version", "2.0"}, {"generator", "Interflect"}};
  json_["extensionsUsed"] = {"KHR_materials_unlit"};
  json_["scene"] = 0;
  json_["scenes"] = Json::array({{{"nodes", Json::array()}}});
  for (const char* key : {"nodes", "meshes", "materials", "accessors", "bufferViews"}) json_[key] = Json::array();
  // Viewers without the extension show a black body that shines by nothing but its base colour.
  json_["materials"].push_back(
      {{"name", "radiosity"},
       {"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 1, 1}}, {"metallicFactor", 0}, {"roughnessFactor", 1}}},
       {"extensions", {{"KHR_materials_unlit", Json::object()}}}});
}

template <std::size_t Size>
std::size_t GlbAsset::add_vectors(const std::vector<std::array<float, Size>>& values, bool bounds) {
  const std::size_t start = binary_.size();
  std::array<float, Size> low = values.front(), high = low;
  for (const auto& v : values) {
    for (std::size_t c = 0; c < Size; ++c) {
      append_little_endian(binary_, v[c]);
      low[c] = std::min(low[c], v[c]), high[c] = std::max(high[c], v[c]);
    }
  }
  Json accessor = {{"bufferView", add_view(start, array_buffer)},
                   {"componentType", static_cast<int>(type_float)},
                   {"count", values.size()},
                   {"type", fmt::format("VEC{}", Size)}};
  if (bounds) accessor["min"] = low, accessor["max"] = high;
  return add("accessors", std::move(accessor));
}
template std::size_t GlbAsset::add_vectors<2>(const std::vector<std::array<float, 2>>&, bool);
template std::size_t GlbAsset::add_vectors<3>(const std::vector<std::array<float, 3>>&, bool);
template std::size_t GlbAsset::add_vectors<4>(const std::vector<std::array<float, 4>>&, bool);

std::size_t GlbAsset::add_indices(const std::vector<std::uint32_t>& values) {
  const std::size_t start = binary_.size();
  for (const std::uint32_t v : values) append_little_endian(binary_, v);
  return add("accessors", {{"bufferView", add_view(start, element_array_buffer)},
                           {"componentType", static_cast<int>(type_uint)},
                           {"count", values.size()},
                           {"type", "SCALAR"}});
}

std::size_t GlbAsset::add_texture(const std::string& name, const std::string& png) {
  for (const char* key : {"images", "samplers", "textures"}) {
    if (!json_.contains(key)) json_[key] = Json::array();
  }
  const std::size_t start = binary_.size();
  binary_ += png;
  const std::size_t view = add_view(start, 0);
  binary_.append((4 - binary_.size() % 4) % 4, '\0');
  const std::size_t image = add("images", {{"name", name}, {"mimeType", "image/png"}, {"bufferView", view}});
  // Smaller copies of the image would mix charts that lie side by side.
  const std::size_t sampler = add("samplers", {{"magFilter", static_cast<int>(filter_linear)},
                                               {"minFilter", static_cast<int>(filter_linear)},
                                               {"wrapS", static_cast<int>(clamp_to_edge)},
                                               {"wrapT", static_cast<int>(clamp_to_edge)}});
  return add("textures", {{"name", name}, {"sampler", sampler}, {"source", image}});
}

std::size_t GlbAsset::add(const char* list, Json entry) {
  json_[list].push_back(std::move(entry));
  return json_[list].size() - 1;
}

void GlbAsset::write(const std::filesystem::path& path) {
  json_["buffers"] = Json::array({{{"byteLength", binary_.size()}}});
  std::string text = json_.dump(-1, ' ', false, Json::error_handler_t::replace);
  text.append((4 - text.size() % 4) % 4, ' ');
  binary_.append((4 - binary_.size() % 4) % 4, '\0');
  const std::size_t total = 12 + 8 + text.size() + 8 + binary_.size();
  if (total > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorKind::limit,
                fmt::format("{}: a GLB file holds at most 4 GiB, this mesh needs {} bytes", path.string(), total));
  }
  std::string head;
  const auto number = [&](std::size_t n) { append_little_endian(head, static_cast<std::uint32_t>(n)); };
  head += "glTF";
  number(2), number(total);
  number(text.size());
  head += "JSON" + text;
  number(binary_.size());
  head += std::string("BIN\0", 4);
  AtomicFile file(path);
  file.write(head);
  file.write(binary_);
  file.commit();
}

std::size_t GlbAsset::add_view(std::size_t start, int target) {
  Json view = {{"buffer", 0}, {"byteOffset", start}, {"byteLength", binary_.size() - start}};
  if (target != 0) view["target"] = target;
  return add("bufferViews", std::move(view));
}

}  // namespace interflect
