#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <tuple>
#include <unordered_map>

#include "interflect/base/error.h"
#include "interflect/scene/affine.h"
#include "interflect/scene/gltf_accessor.h"
#include "interflect/scene/gltf_document.h"
#include "interflect/scene/gltf_material.h"
#include "interflect/scene/gltf_node.h"
#include "interflect/scene/scene_limits.h"

namespace interflect {

namespace {

using gltf::Accessor;
using gltf::Document;
using gltf::Materials;

/// TINYGLTF_MODE_... to the corners of triangle t: positions in the list of indices.
std::array<std::size_t, 3> corners_of(int mode, std::size_t t) {
  if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) return {t, t + 1 + t % 2, t + 2 - t % 2};
  if (mode == TINYGLTF_MODE_TRIANGLE_FAN) return {t + 1, t + 2, 0};
  return {3 * t, 3 * t + 1, 3 * t + 2};
}

class Reader {
 public:
  Reader(const Document& document, const std::string& file)
      : document_(document), model_(document.model), file_(file), materials_(document, scene_) {}

  Scene run() {
    note_what_is_left_out();
    for (const int root : roots()) walk(root);
    if (scene_.triangles.empty()) throw fail("no triangles in the scene");
    while (scene_.warnings.size() > max_scene_warnings) scene_.warnings.pop_back();
    return std::move(scene_);
  }

 private:
  [[nodiscard]] Error fail(std::string_view cause) const { return input_error(file_, 0, cause); }

  void warn(std::string_view text) {
    if (scene_.warnings.size() < max_scene_warnings) scene_.warnings.emplace_back(fail(text).what());
  }

  void note_what_is_left_out() {
    constexpr std::array<std::string_view, 3> known{"KHR_materials_emissive_strength", "KHR_mesh_quantization",
                                                    "KHR_texture_transform"};
    for (const std::string& name : model_.extensionsUsed) {
      if (std::find(known.begin(), known.end(), name) == known.end())
        warn(fmt::format("extension {} is ignored", name));
    }
    if (!model_.skins.empty()) warn("skins are ignored: meshes are taken as they are stored");
    if (!model_.animations.empty()) warn("animations are ignored");
    for (std::size_t i = 0; i < model_.materials.size(); ++i) {
      const tinygltf::Material& m = model_.materials[i];
      const auto who = [&] { return fmt::format("material {} ('{}')", i, m.name); };
      if (m.alphaMode != "OPAQUE") warn(fmt::format("{}: alphaMode {} is ignored, it is opaque", who(), m.alphaMode));
      const bool metallic = m.values.contains("metallicFactor") && m.pbrMetallicRoughness.metallicFactor > 0.5 &&
                            m.pbrMetallicRoughness.metallicRoughnessTexture.index < 0;
      if (metallic) warn(fmt::format("{}: metallic; its base colour is taken as diffuse reflectance", who()));
    }
  }

  /// The root nodes of the default scene, of the first one where none is named, and all where there is no scene.
  std::vector<int> roots() const {
    const int wanted = model_.defaultScene < 0 ? 0 : model_.defaultScene;
    if (static_cast<std::size_t>(wanted) < model_.scenes.size()) {
      return model_.scenes[static_cast<std::size_t>(wanted)].nodes;
    }
    if (model_.defaultScene >= 0) throw fail(fmt::format("scene {} does not exist", wanted));
    std::vector<bool> child(model_.nodes.size());
    for (const tinygltf::Node& node : model_.nodes) {
      for (const int c : node.children) {
        if (c >= 0 && static_cast<std::size_t>(c) < child.size()) child[static_cast<std::size_t>(c)] = true;
      }
    }
    std::vector<int> list;
    for (std::size_t i = 0; i < child.size(); ++i) {
      if (!child[i]) list.push_back(static_cast<int>(i));
    }
    return list;
  }

  struct Visit {
    int node;
    Affine parent;
  };

  void walk(int root) {
    visited_.resize(model_.nodes.size());
    std::vector<Visit> open{{root, Affine{}}};
    group_.clear();
    while (!open.empty()) {
      const Visit visit = open.back();
      open.pop_back();
      if (visit.node < 0 || static_cast<std::size_t>(visit.node) >= model_.nodes.size()) {
        throw fail(fmt::format("node {} does not exist", visit.node));
      }
      const auto index = static_cast<std::size_t>(visit.node);
      const tinygltf::Node& node = model_.nodes[index];
      if (visited_[index]) {
        throw fail(fmt::format("{} is reached twice: it has two parents or contains itself",
                               gltf::node_name(document_, visit.node)));
      }
      visited_[index] = true;
      const Affine world = visit.parent * gltf::transformation(document_, visit.node);
      if (visit.node == root) group_ = name_of(node, visit.node);
      if (node.camera >= 0) camera(node.camera, world);
      if (node.mesh >= 0) mesh(node, visit.node, world);
      for (auto child = node.children.rbegin(); child != node.children.rend(); ++child) open.push_back({*child, world});
    }
  }

  std::string name_of(const tinygltf::Node& node, int index) const {
    std::string name = node.name;
    const auto m = static_cast<std::size_t>(node.mesh);
    if (name.empty() && node.mesh >= 0 && m < model_.meshes.size()) name = model_.meshes[m].name;
    return name.empty() ? fmt::format("node {}", index) : name.substr(0, max_scene_name);
  }

  void camera(int index, const Affine& world) {
    if (static_cast<std::size_t>(index) >= model_.cameras.size())
      throw fail(fmt::format("camera {} does not exist", index));
    const tinygltf::Camera& source = model_.cameras[static_cast<std::size_t>(index)];
    if (scene_.camera || source.type != "perspective") return;
    const double fov = source.perspective.yfov;
    if (!(fov > 0 && fov < std::numbers::pi)) throw fail(fmt::format("camera {}: yfov is {}", index, fov));
    const Vec3 forward = normalized(-world.z), up = normalized(world.y);
    if (!finite(world.origin) || !(length(cross(forward, up)) > 1e-6)) {
      throw fail(fmt::format("camera {}: its node's transformation leaves it no direction", index));
    }
    scene_.camera = Camera{world.origin, world.origin + forward, up, fov};
  }

  void mesh(const tinygltf::Node& node, int index, const Affine& world) {
    if (static_cast<std::size_t>(node.mesh) >= model_.meshes.size())
      throw fail(fmt::format("mesh {} does not exist", node.mesh));
    const tinygltf::Mesh& m = model_.meshes[static_cast<std::size_t>(node.mesh)];
    for (std::size_t p = 0; p < m.primitives.size(); ++p) {
      place_ = fmt::format("mesh {} ('{}') primitive {}", node.mesh, m.name, p);
      primitive(m.primitives[p], name_of(node, index), world);
    }
  }

  const Accessor& accessor(int index, int type) {
    const auto key = std::pair{index, type};
    const auto found = accessors_.find(key);
    return found != accessors_.end() ? found->second
                                     : accessors_.try_emplace(key, document_, index, type).first->second;
  }

  /// The number of triangles, counted against the limit before anything is made. An empty primitive counts as one, so
  /// that many of them do not take forever either.
  std::size_t count_triangles(int mode, std::size_t corners) {
    const bool list = mode == TINYGLTF_MODE_TRIANGLES;
    if (list && corners % 3 != 0) throw fail(fmt::format("{}: {} corners are not whole triangles", place_, corners));
    const std::size_t triangles = list ? corners / 3 : corners < 3 ? 0 : corners - 2;
    spent_ += std::max<std::uint64_t>(1, std::min<std::uint64_t>(triangles, 2 * max_scene_triangles));
    if (spent_ > max_scene_triangles)
      throw fail(fmt::format("{}: more than {} triangles", place_, max_scene_triangles));
    return triangles;
  }

  void primitive(const tinygltf::Primitive& p, const std::string& object, const Affine& world) {
    const int mode = p.mode < 0 ? TINYGLTF_MODE_TRIANGLES : p.mode;
    if (mode > TINYGLTF_MODE_TRIANGLE_FAN) throw fail(fmt::format("{}: mode {} does not exist", place_, mode));
    if (mode < TINYGLTF_MODE_TRIANGLES) {
      count_triangles(TINYGLTF_MODE_TRIANGLES, 0);
      return warn(fmt::format("{}: points and lines are left out", place_));
    }
    const auto position = p.attributes.find("POSITION");
    if (position == p.attributes.end()) throw fail(fmt::format("{} has no POSITION", place_));
    const Accessor& positions = accessor(position->second, TINYGLTF_TYPE_VEC3);
    const Accessor* indices = p.indices < 0 ? nullptr : &accessor(p.indices, TINYGLTF_TYPE_SCALAR);
    if (indices != nullptr && !indices->is_index())
      throw fail(fmt::format("{}: its indices are not unsigned integers", place_));
    const std::size_t triangles = count_triangles(mode, indices != nullptr ? indices->count() : positions.count());
    if (triangles == 0) return;
    if (!p.targets.empty()) warn(fmt::format("{}: morph targets are ignored", place_));

    const Materials::Entry& material = materials_.get(p.material);
    const Accessor* uvs = texture_coordinates(p, material, positions.count());
    Triangle t;
    t.surface = surface(object, material.index);
    const bool mirrored = world.determinant() < 0;
    std::unordered_map<std::size_t, std::uint32_t> placed;  // vertex of the file -> Scene::positions
    for (std::size_t i = 0; i < triangles; ++i) {
      std::array<std::size_t, 3> corner = corners_of(mode, i);
      if (mirrored) std::swap(corner[1], corner[2]);
      if (material.coordinates.set >= 0) t.uv = static_cast<std::int64_t>(scene_.uvs.size());
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t v = indices != nullptr ? indices->integer(corner[k]) : corner[k];
        if (v >= positions.count())
          throw fail(fmt::format("{}: index {} of {} vertices", place_, v, positions.count()));
        const auto [entry, added] = placed.try_emplace(v, static_cast<std::uint32_t>(scene_.positions.size()));
        if (added) scene_.positions.push_back(point(positions.vec3(v), world, v));
        t.vertex[k] = entry->second;
        if (t.uv >= 0) scene_.uvs.push_back(coordinate(uvs, material, v));
      }
      scene_.triangles.push_back(t);
    }
  }

  Vec3 point(Vec3 local, const Affine& world, std::size_t vertex) const {
    const Vec3 p = world.point(local);
    if (!(std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}) <= max_scene_coordinate)) {
      throw fail(
          fmt::format("{}: vertex {} is not finite or further out than {:g}", place_, vertex, max_scene_coordinate));
    }
    return p;
  }

  const Accessor* texture_coordinates(const tinygltf::Primitive& p, const Materials::Entry& material,
                                      std::size_t vertices) {
    if (material.coordinates.set < 0) return nullptr;
    const std::string name = fmt::format("TEXCOORD_{}", material.coordinates.set);
    const auto found = p.attributes.find(name);
    if (found == p.attributes.end()) {
      warn(fmt::format("{} has a texture but no {}: the first texel is taken", place_, name));
      return nullptr;
    }
    const Accessor& uvs = accessor(found->second, TINYGLTF_TYPE_VEC2);
    if (uvs.count() < vertices) throw fail(fmt::format("{}: {} is shorter than POSITION", place_, name));
    return &uvs;
  }

  Vec2 coordinate(const Accessor* uvs, const Materials::Entry& material, std::size_t vertex) const {
    const Vec2 raw = uvs == nullptr ? Vec2{} : uvs->vec2(vertex);
    if (!(std::max(std::abs(raw.x), std::abs(raw.y)) < 1e9)) {
      throw fail(fmt::format("{}: texture coordinate {} is not finite or very large", place_, vertex));
    }
    return material.coordinates.apply(raw);
  }

  std::uint32_t surface(const std::string& object, std::uint32_t material) {
    const auto next = static_cast<std::uint32_t>(scene_.surfaces.size());
    const auto [entry, added] = surfaces_.try_emplace({object, group_, material}, next);
    if (added && next >= max_scene_surfaces)
      throw fail(fmt::format("more than {} combinations of node and material", next));
    if (added) scene_.surfaces.push_back({object, group_, material});
    return entry->second;
  }

  const Document& document_;
  const tinygltf::Model& model_;
  const std::string& file_;
  Scene scene_;
  Materials materials_;
  std::map<std::pair<int, int>, Accessor> accessors_;
  std::map<std::tuple<std::string, std::string, std::uint32_t>, std::uint32_t> surfaces_;
  std::vector<bool> visited_;
  std::string group_;  // name of the current root node
  std::string place_;  // the current primitive, for messages
  std::uint64_t spent_ = 0;
};

}  // namespace

Scene read_gltf(const std::string& bytes, const std::filesystem::path& path) {
  const std::string file = path.string();
  try {
    const Document document = gltf::load(bytes, path);
    Scene scene = Reader(document, file).run();
    scene.name = path.stem().string();
    scene.file = file;
    scene.files = document.files;
    return scene;
  } catch (const std::logic_error& error) {  // tinygltf's containers and JSON types
    throw input_error(file, 0, fmt::format("not valid glTF: {}", error.what()));
  } catch (const nlohmann::json::exception& error) {
    throw input_error(file, 0, fmt::format("not valid glTF: {}", error.what()));
  }
}

}  // namespace interflect
