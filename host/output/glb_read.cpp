#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <unordered_map>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/hanging.h"
#include "interflect/output/lit_mesh.h"
#include "interflect/scene/gltf_accessor.h"
#include "interflect/scene/gltf_document.h"

namespace interflect {

namespace {

constexpr const char* radiosity_name = "_RADIOSITY";
constexpr const char* emittance_name = "_EMITTANCE";

bool is_ours(const tinygltf::Model& model) {
  if (model.asset.generator.starts_with("Interflect")) return true;
  for (const auto& mesh : model.meshes) {
    for (const auto& primitive : mesh.primitives) {
      if (primitive.attributes.contains(radiosity_name)) return true;
    }
  }
  return false;
}

/// Positions to indices: our writer repeats a position for each surface that meets there, bit for bit.
class Welder {
 public:
  explicit Welder(std::vector<Vec3>& vertices) : vertices_(vertices) {}
  std::uint32_t operator()(Vec3 p) {
    const auto [it, fresh] = known_.try_emplace({p.x + 0.0, p.y + 0.0, p.z + 0.0},  // -0 and 0 are one place
                                                static_cast<std::uint32_t>(vertices_.size()));
    if (fresh) vertices_.push_back(p);
    return it->second;
  }

 private:
  struct Hash {
    std::size_t operator()(const Vec3& p) const {
      std::uint64_t hash = 0;
      for (int axis = 0; axis < 3; ++axis) {
        hash = (hash ^ std::bit_cast<std::uint64_t>(p[axis])) * 0x9E3779B97F4A7C15U;
        hash ^= hash >> 29;
      }
      return hash;
    }
  };
  std::vector<Vec3>& vertices_;
  std::unordered_map<Vec3, std::uint32_t, Hash> known_;
};

class Reader {
 public:
  explicit Reader(const gltf::Document& document) : document_(document), weld_(lit_.mesh.vertices) {
    constexpr std::uint64_t generous = 16, most = std::numeric_limits<std::uint32_t>::max();
    for (const auto& buffer : document.model.buffers) left_ += buffer.data.size();
    left_ = std::min(generous * left_, most);
  }

  [[nodiscard]] LitMesh read() {
    check_nodes();
    for (const auto& mesh : document_.model.meshes) {
      for (const auto& primitive : mesh.primitives) read_primitive(mesh.name, primitive);
    }
    const std::vector<double>& area = lit_.mesh.area;
    if (area.empty()) throw fail("holds no patches");
    if (std::none_of(area.begin(), area.end(), [](double a) { return a > 0; })) throw fail("no patch has an area");
    const Continues continues(lit_.mesh, smooth_crease);
    lit_.smooth.walls = Walls(lit_.mesh, continues);
    return std::move(lit_);
  }

 private:
  [[nodiscard]] Error fail(std::string_view cause) const {
    return input_error(document_.file, 0, fmt::format("solved GLB: {}", cause));
  }

  /// Every number takes a byte at least, and the writer shares none: a file that asks for far more than it holds would
  /// take any memory and time.
  void take(const std::string& mesh, std::size_t elements, std::uint64_t bytes_of_each) {
    if (elements > left_ / bytes_of_each) {
      throw fail(fmt::format("mesh '{}': more values than the file has bytes for", mesh));
    }
    left_ -= elements * bytes_of_each;
  }

  void check_nodes() const {
    for (const auto& node : document_.model.nodes) {
      if (node.matrix.empty() && node.translation.empty() && node.rotation.empty() && node.scale.empty()) continue;
      throw fail(fmt::format("node '{}' was moved: its light no longer fits", node.name));
    }
  }

  /// An attribute with a value per vertex, finite; not negative where it is light.
  [[nodiscard]] gltf::Accessor attribute(const std::string& mesh, const tinygltf::Primitive& primitive,
                                         const std::string& name, bool light) {
    const auto found = primitive.attributes.find(name);
    if (found == primitive.attributes.end()) {
      throw fail(fmt::format("mesh '{}': the attribute {} is missing: solve the scene again", mesh, name));
    }
    gltf::Accessor values(document_, found->second, TINYGLTF_TYPE_VEC3);
    take(mesh, values.count(), 3);
    for (std::size_t i = 0; i < values.count(); ++i) {
      const Vec3 v = values.vec3(i);
      if (finite(v) && !(light && (v.x < 0 || v.y < 0 || v.z < 0))) continue;
      throw fail(
          fmt::format("mesh '{}': the attribute {} is damaged: {} {} {} at vertex {}", mesh, name, v.x, v.y, v.z, i));
    }
    return values;
  }

  void read_primitive(const std::string& name, const tinygltf::Primitive& primitive) {
    const gltf::Accessor position = attribute(name, primitive, "POSITION", false);
    const gltf::Accessor radiosity = attribute(name, primitive, radiosity_name, true);
    if (radiosity.count() != position.count()) {
      throw fail(fmt::format("mesh '{}': the attribute {} is damaged: {} values for {} vertices", name, radiosity_name,
                             radiosity.count(), position.count()));
    }
    if (primitive.mode != TINYGLTF_MODE_TRIANGLES && primitive.mode != -1) {
      throw fail(fmt::format("mesh '{}' is not made of triangles", name));
    }
    const auto first = static_cast<std::uint32_t>(lit_.smooth.vertex.size());
    for (std::size_t v = 0; v < position.count(); ++v) {
      lit_.smooth.vertex.push_back(weld_(position.vec3(v)));
      lit_.smooth.normal.emplace_back();
      const Vec3 b = radiosity.vec3(v);
      lit_.radiosity.push_back({b.x, b.y, b.z});
    }
    const std::vector<Rgb> emittance = read_emittance(name, primitive, position.count());
    const gltf::Accessor indices(document_, primitive.indices, TINYGLTF_TYPE_SCALAR);
    if (!indices.is_index() || indices.count() % 3 != 0) throw fail(fmt::format("mesh '{}': damaged indices", name));
    take(name, indices.count(), 1);
    const auto surface = static_cast<std::uint32_t>(lit_.mesh.surfaces.size());
    lit_.mesh.surfaces.push_back({name, name, surface});
    for (std::size_t k = 0; k < indices.count(); k += 3) {
      std::array<std::uint32_t, 3> corners{};
      for (std::size_t c = 0; c < 3; ++c) {
        corners[c] = indices.integer(k + c);
        if (corners[c] >= position.count()) {
          throw fail(fmt::format("mesh '{}': index {} of {} vertices", name, corners[c], position.count()));
        }
      }
      add_patch(corners, first, surface, emittance[corners[0]]);
    }
  }

  [[nodiscard]] std::vector<Rgb> read_emittance(const std::string& name, const tinygltf::Primitive& primitive,
                                                std::size_t count) {
    std::vector<Rgb> emittance(count);
    if (!primitive.attributes.contains(emittance_name)) return emittance;
    const gltf::Accessor values = attribute(name, primitive, emittance_name, true);
    if (values.count() != count) {
      throw fail(fmt::format("mesh '{}': the attribute {} is damaged: {} values for {} vertices", name, emittance_name,
                             values.count(), count));
    }
    for (std::size_t v = 0; v < count; ++v) {
      const Vec3 e = values.vec3(v);
      emittance[v] = {e.x, e.y, e.z};
    }
    return emittance;
  }

  void add_patch(std::array<std::uint32_t, 3> corners, std::uint32_t first, std::uint32_t surface,
                 const Rgb& emittance) {
    PatchMesh& mesh = lit_.mesh;
    for (std::uint32_t& c : corners) c += first;
    lit_.smooth.corners.push_back(corners);
    for (std::uint32_t& c : corners) c = lit_.smooth.vertex[c];
    mesh.corners.push_back(corners);
    const auto t = mesh.triangle(mesh.size() - 1);
    const Vec3 n = cross(t[1] - t[0], t[2] - t[0]);
    mesh.area.push_back(length(n) / 2);
    mesh.normal.push_back(normalized(n));
    mesh.centroid.push_back((t[0] + t[1] + t[2]) / 3);
    mesh.reflectance.push_back({});
    mesh.emittance.push_back(emittance);
    mesh.surface.push_back(surface);
    mesh.source.push_back(static_cast<std::uint32_t>(mesh.source.size()));
  }

  const gltf::Document& document_;
  LitMesh lit_;
  Welder weld_;
  std::uint64_t left_ = 0;  ///< see take()
};

}  // namespace

std::optional<LitMesh> read_solved_glb(const std::filesystem::path& path) {
  const gltf::Document document = gltf::load(read_file(path), path);
  if (!is_ours(document.model)) return std::nullopt;
  return Reader(document).read();
}

}  // namespace interflect
