#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/bytes.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

using Json = nlohmann::ordered_json;

enum : int { array_buffer = 34962, element_array_buffer = 34963, type_float = 5126, type_uint = 5125 };

/// The vertices and triangles of one group, as a primitive needs them.
struct Part {
  std::vector<std::uint32_t> vertices;  ///< smooth vertices, in the order of their first use
  std::vector<std::uint32_t> indices;   ///< into vertices
};

std::vector<Part> split_by_group(const Solution& solution, const SmoothMesh& smooth) {
  const PatchMesh& mesh = *solution.mesh;
  std::vector<Part> parts(solution.grouping.names.size());
  std::vector<std::vector<std::uint32_t>> patches(parts.size());
  for (std::uint32_t i = 0; i < mesh.size(); ++i) patches[solution.grouping.of_surface[mesh.surface[i]]].push_back(i);
  constexpr auto unused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> local(smooth.size(), unused);
  for (std::size_t g = 0; g < parts.size(); ++g) {
    for (const std::uint32_t i : patches[g]) {
      for (const std::uint32_t s : smooth.corners[i]) {
        if (local[s] == unused) {
          local[s] = static_cast<std::uint32_t>(parts[g].vertices.size());
          parts[g].vertices.push_back(s);
        }
        parts[g].indices.push_back(local[s]);
      }
    }
    for (const std::uint32_t s : parts[g].vertices) local[s] = unused;
  }
  return parts;
}

/// The JSON chunk and the binary chunk as they grow together.
class Asset {
 public:
  Asset() {
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

  Json& json() { return json_; }

  /// An accessor over `Size` floats per element.
  template <std::size_t Size>
  std::size_t add_vectors(const std::vector<std::array<float, Size>>& values, bool bounds) {
    const std::size_t start = binary_.size();
    std::array<float, Size> low = values.front(), high = low;
    for (const auto& v : values) {
      for (std::size_t c = 0; c < Size; ++c) {
        append_little_endian(binary_, v[c]);
        low[c] = std::min(low[c], v[c]), high[c] = std::max(high[c], v[c]);
      }
    }
    Json accessor = add_view(start, array_buffer, type_float, values.size(), Size == 3 ? "VEC3" : "VEC4");
    if (bounds) accessor["min"] = low, accessor["max"] = high;
    return add("accessors", std::move(accessor));
  }

  std::size_t add_indices(const std::vector<std::uint32_t>& values) {
    const std::size_t start = binary_.size();
    for (const std::uint32_t v : values) append_little_endian(binary_, v);
    return add("accessors", add_view(start, element_array_buffer, type_uint, values.size(), "SCALAR"));
  }

  std::size_t add(const char* list, Json entry) {
    json_[list].push_back(std::move(entry));
    return json_[list].size() - 1;
  }

  void write(const std::filesystem::path& path) {
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

 private:
  Json add_view(std::size_t start, int target, int component, std::size_t count, const char* type) {
    const std::size_t view =
        add("bufferViews",
            {{"buffer", 0}, {"byteOffset", start}, {"byteLength", binary_.size() - start}, {"target", target}});
    return {{"bufferView", view}, {"componentType", component}, {"count", count}, {"type", type}};
  }

  Json json_;
  std::string binary_;
};

std::array<float, 3> floats(Vec3 v) {
  return {finite_float(v.x), finite_float(v.y), finite_float(v.z)};
}
std::array<float, 3> floats(const Rgb& c) {
  return {finite_float(c[0]), finite_float(c[1]), finite_float(c[2])};
}

/// See output.h: the factor from radiosity to COLOR_0.
double color_scale(const Solution& solution) {
  constexpr double very_dark = 16;
  double largest = 0;
  for (const Rgb& b : solution.radiosity) largest = std::max(largest, brightness(b));
  const double exposure = surface_exposure(*solution.mesh, solution.radiosity);
  return largest <= 1 && exposure <= very_dark ? 1 : exposure;
}

}  // namespace

void write_glb(const Solution& solution, const std::filesystem::path& path) {
  check_solution(solution);
  const PatchMesh& mesh = *solution.mesh;
  const SmoothMesh smooth = smooth_mesh(mesh);
  const std::vector<Rgb> radiosity = smooth_radiosities(smooth, mesh, solution.radiosity);
  const double scale = color_scale(solution);
  const std::vector<Part> parts = split_by_group(solution, smooth);
  std::vector<Rgb> emittance(smooth.size());  // lamps and what is lit never share a smooth vertex
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    for (const std::uint32_t s : smooth.corners[i]) emittance[s] = mesh.emittance[i];
  }
  Asset asset;
  asset.json()["scenes"][0]["extras"] = {{"interflect_color_scale", scale}};
  for (std::size_t g = 0; g < parts.size(); ++g) {
    if (parts[g].indices.empty()) continue;
    std::vector<std::array<float, 3>> position, normal, linear, emitted;
    std::vector<std::array<float, 4>> colour;  // opaque: some readers take a missing alpha for 0
    for (const std::uint32_t s : parts[g].vertices) {
      const Rgb& b = radiosity[s];
      position.push_back(floats(mesh.vertices[smooth.vertex[s]]));
      normal.push_back(floats(smooth.normal[s]));
      const auto shown = floats(tone_map({scale * b[0], scale * b[1], scale * b[2]}, ToneMap::linear));
      colour.push_back({shown[0], shown[1], shown[2], 1});
      linear.push_back(floats(b));
      emitted.push_back(floats(emittance[s]));
    }
    Json attributes = {{"POSITION", asset.add_vectors(position, true)},
                       {"NORMAL", asset.add_vectors(normal, false)},
                       {"COLOR_0", asset.add_vectors(colour, false)},
                       {"_RADIOSITY", asset.add_vectors(linear, false)}};
    if (std::any_of(parts[g].vertices.begin(), parts[g].vertices.end(), [&](auto s) { return emits(emittance[s]); })) {
      attributes["_EMITTANCE"] = asset.add_vectors(emitted, false);
    }
    const Json primitive = {
        {"attributes", attributes}, {"indices", asset.add_indices(parts[g].indices)}, {"material", 0}};
    const std::string& name = solution.grouping.names[g];
    const std::size_t drawn = asset.add("meshes", {{"name", name}, {"primitives", Json::array({primitive})}});
    const std::size_t node = asset.add("nodes", {{"name", name}, {"mesh", drawn}});
    asset.json()["scenes"][0]["nodes"].push_back(node);
  }
  asset.write(path);
}

}  // namespace interflect
