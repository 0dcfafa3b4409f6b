#include "interflect/scene/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <string_view>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/file.h"

namespace interflect {

double Scene::area(const Triangle& t) const {
  const Vec3 a = positions[t.vertex[0]], b = positions[t.vertex[1]], c = positions[t.vertex[2]];
  return 0.5 * length(cross(b - a, c - a));
}

namespace {

const std::string& name_of(const Scene& scene, const Surface& surface, GroupBy by) {
  switch (by) {
    case GroupBy::group: return surface.group;
    case GroupBy::material: return scene.materials[surface.material].name;
    case GroupBy::object:
    case GroupBy::automatic: break;
  }
  return surface.object;
}

Grouping group_by(const Scene& scene, GroupBy by) {
  Grouping grouping;
  std::map<std::pair<bool, std::string_view>, std::uint32_t> index;  // an obstruction never joins other surfaces
  for (const Surface& surface : scene.surfaces) {
    const std::string& name = name_of(scene, surface, by);
    const auto [entry, added] =
        index.try_emplace({surface.obstruction, name}, static_cast<std::uint32_t>(grouping.names.size()));
    if (added) {
      grouping.names.push_back(name);
      grouping.obstruction.push_back(surface.obstruction);
    }
    grouping.of_surface.push_back(entry->second);
  }
  return grouping;
}

}  // namespace

Grouping group_surfaces(const Scene& scene, GroupBy by) {
  if (by != GroupBy::automatic) return group_by(scene, by);
  for (const GroupBy candidate : {GroupBy::group, GroupBy::object}) {
    Grouping grouping = group_by(scene, candidate);
    if (grouping.names.size() > 1) return grouping;
  }
  return group_by(scene, GroupBy::material);
}

Scene read_scene(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension != ".xml" && extension != ".obj" && extension != ".gltf" && extension != ".glb" &&
      extension != ".vs3") {
    throw input_error(path.string(), 0,
                      fmt::format("'{}' is not a scene format (.xml, .obj, .gltf, .glb, .vs3)", extension));
  }
  const std::string content = read_file(path);
  Scene scene = extension == ".xml"   ? read_rrv_xml(content, path)
                : extension == ".obj" ? read_obj(content, path)
                : extension == ".vs3" ? read_vs3(content, path)
                                      : read_gltf(content, path);
  scene.name = path.stem().string();
  scene.file = path.string();
  scene.files.push_back(path);
  return scene;
}

}  // namespace interflect
