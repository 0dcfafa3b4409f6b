#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <unordered_map>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/output/bytes.h"
#include "interflect/output/glb_asset.h"
#include "interflect/output/joints.h"
#include "interflect/output/lightmap.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

using Json = GlbAsset::Json;
using Floats3 = std::array<float, 3>;

/// A vertex of the file: a smooth vertex, once for each chart that it is in, or a joint between two of them.
struct Vertex {
  std::uint32_t vertex = 0;             ///< into PatchMesh::vertices
  std::array<std::uint32_t, 2> ends{};  ///< smooth vertices; equal where it is one itself
  double share = 0;                     ///< from the first to the second
  std::uint32_t chart = 0;
};

/// The vertices and triangles of one group of surfaces, as a primitive needs them.
struct Part {
  std::vector<Vertex> vertices;        ///< in the order of their first use
  std::vector<std::uint32_t> indices;  ///< into vertices
};

std::vector<Part> split_by_group(const Solution& solution, const SmoothMesh& smooth, const Lightmap* lightmap) {
  const PatchMesh& mesh = *solution.mesh;
  std::vector<Part> parts(solution.grouping.names.size());
  std::vector<std::vector<std::uint32_t>> patches(parts.size());
  for (std::uint32_t i = 0; i < mesh.size(); ++i) patches[solution.grouping.of_surface[mesh.surface[i]]].push_back(i);
  const JointCutter cutter(mesh);
  std::unordered_map<std::uint64_t, std::uint32_t> corners, joints;  // of a group; of a patch
  for (std::size_t g = 0; g < parts.size(); ++g) {
    corners.clear();
    Part& part = parts[g];
    for (const std::uint32_t i : patches[g]) {
      const std::uint32_t chart = lightmap == nullptr ? 0 : lightmap->atlas.charts.of_patch[i];
      joints.clear();
      for (const auto& triangle : cutter.cut(i)) {
        for (const Joint& joint : triangle) {
          const std::uint32_t s = smooth.corners[i][joint.ends[0]], t = smooth.corners[i][joint.ends[1]];
          const auto next = static_cast<std::uint32_t>(part.vertices.size());
          const auto [at, added] = s == t ? corners.try_emplace(std::uint64_t{chart} << 32U | s, next)
                                          : joints.try_emplace(joint.vertex, next);
          if (added) part.vertices.push_back({joint.vertex, {s, t}, joint.share, chart});
          part.indices.push_back(at->second);
        }
      }
    }
  }
  return parts;
}

Floats3 floats(Vec3 v) {
  return {finite_float(v.x), finite_float(v.y), finite_float(v.z)};
}
Floats3 floats(const Rgb& c) {
  return {finite_float(c[0]), finite_float(c[1]), finite_float(c[2])};
}

void check_lit(const Solution& solution) {
  const std::size_t groups = solution.lit.size();
  if (groups != 0 && solution.lights.names.size() != groups) {
    throw Error(ErrorKind::internal,
                fmt::format("output: {} names for {} light groups", solution.lights.names.size(), groups));
  }
}

/// Light at the smooth vertices: of all lamps, and of each group alone.
struct VertexLight {
  std::vector<Rgb> all;
  std::vector<std::vector<Rgb>> groups;
  std::vector<Rgb> emittance;  ///< lamps and what is lit never share a smooth vertex
};

/// Writes the primitives of one file.
class GlbWriter {
 public:
  GlbWriter(const Solution& solution, const SmoothMesh& smooth, const Lightmap* lightmap)
      : mesh_(*solution.mesh), smooth_(smooth), lightmap_(lightmap) {
    light_.all = smooth_radiosities(smooth, mesh_, solution.radiosity);
    for (const auto& lit : solution.lit) light_.groups.push_back(smooth_radiosities(smooth, mesh_, lit));
    light_.emittance.resize(smooth.size());
    for (std::size_t i = 0; i < mesh_.size(); ++i) {
      for (const std::uint32_t v : smooth.corners[i]) light_.emittance[v] = mesh_.emittance[i];
    }
    scale_ = color_scale(mesh_, solution.radiosity);
    Json extras = {{"interflect_color_scale", scale_}};
    if (!solution.lit.empty()) extras["interflect_light_groups"] = solution.lights.names;
    if (lightmap != nullptr) {
      const Atlas& atlas = lightmap->atlas;
      extras["interflect_lightmap"] = {
          {"size", atlas.size}, {"texels_per_unit", atlas.density}, {"padding", atlas.padding}};
      const std::size_t texture = asset_.add_texture("lightmap", lightmap_png(*lightmap, 8));
      // The same coordinates are set 0, for readers that know only that one.
      asset_.material()["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", texture}, {"texCoord", 1}};
    }
    asset_.scene()["extras"] = std::move(extras);
  }

  void add(const std::string& name, const Part& part) {
    const Json primitive = {
        {"attributes", attributes(part)}, {"indices", asset_.add_indices(part.indices)}, {"material", 0}};
    const std::size_t drawn = asset_.add("meshes", {{"name", name}, {"primitives", Json::array({primitive})}});
    const std::size_t node = asset_.add("nodes", {{"name", name}, {"mesh", drawn}});
    asset_.scene()["nodes"].push_back(node);
  }

  void write(const std::filesystem::path& path) { asset_.write(path); }

 private:
  /// An accessor over value(vertex) for the vertices of a part.
  template <class Value>
  std::size_t vectors(const Part& part, const Value& value, bool bounds = false) {
    std::vector<decltype(value(Vertex{}))> values;
    values.reserve(part.vertices.size());
    for (const Vertex& v : part.vertices) values.push_back(value(v));
    return asset_.add_vectors(values, bounds);
  }

  Json attributes(const Part& part) {
    const auto position = [&](const Vertex& v) { return mesh_.vertices[v.vertex]; };
    Json out;
    out["POSITION"] = vectors(
        part, [&](const Vertex& v) { return floats(position(v)); }, true);
    out["NORMAL"] = vectors(part, [&](const Vertex& v) {
      return floats(normalized(smooth_.normal[v.ends[0]] * (1 - v.share) + smooth_.normal[v.ends[1]] * v.share));
    });
    if (lightmap_ == nullptr) {
      out["COLOR_0"] = vectors(part, [&](const Vertex& v) { return colour(at(v, light_.all)); });
    } else {
      const std::size_t places = vectors(part, [&](const Vertex& v) {
        const Vec2 p = lightmap_->atlas.texels(v.chart, position(v)) * (1.0 / lightmap_->atlas.size);
        return std::array<float, 2>{finite_float(p.x), finite_float(p.y)};
      });
      out["TEXCOORD_0"] = places, out["TEXCOORD_1"] = places;
    }
    out["_RADIOSITY"] = vectors(part, [&](const Vertex& v) { return floats(at(v, light_.all)); });
    const auto shines = [&](const Vertex& v) { return emits(at(v, light_.emittance)); };
    if (std::any_of(part.vertices.begin(), part.vertices.end(), shines)) {
      out["_EMITTANCE"] = vectors(part, [&](const Vertex& v) { return floats(at(v, light_.emittance)); });
    }
    for (std::size_t g = 0; g < light_.groups.size(); ++g) {
      out[fmt::format("_GROUP_{}", g)] =
          vectors(part, [&](const Vertex& v) { return floats(at(v, light_.groups[g])); });
    }
    return out;
  }

  /// A value at the smooth vertices, between them where v is.
  static Rgb at(const Vertex& v, const std::vector<Rgb>& values) {
    Rgb out = values[v.ends[0]];
    if (v.ends[0] == v.ends[1]) return out;
    for (std::size_t c = 0; c < 3; ++c) out[c] = (1 - v.share) * out[c] + v.share * values[v.ends[1]][c];
    return out;
  }

  /// Opaque: some readers take a missing alpha for 0.
  [[nodiscard]] std::array<float, 4> colour(const Rgb& b) const {
    const Floats3 c = floats(tone_map({scale_ * b[0], scale_ * b[1], scale_ * b[2]}, ToneMap::linear));
    return {c[0], c[1], c[2], 1};
  }

  const PatchMesh& mesh_;
  const SmoothMesh& smooth_;
  const Lightmap* lightmap_;
  VertexLight light_;
  double scale_ = 1;
  GlbAsset asset_;
};

}  // namespace

void write_glb(const Solution& solution, const std::filesystem::path& path, const Lightmap* lightmap) {
  check_solution(solution);
  check_lit(solution);
  if (lightmap != nullptr && lightmap->atlas.charts.of_patch.size() != solution.mesh->size()) {
    throw Error(ErrorKind::internal, "output: a lightmap of another mesh");
  }
  const SmoothMesh smooth = smooth_mesh(*solution.mesh);
  const std::vector<Part> parts = split_by_group(solution, smooth, lightmap);
  GlbWriter writer(solution, smooth, lightmap);
  for (std::size_t g = 0; g < parts.size(); ++g) {
    if (!parts[g].indices.empty()) writer.add(solution.grouping.names[g], parts[g]);
  }
  writer.write(path);
}

}  // namespace interflect
