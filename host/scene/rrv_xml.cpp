#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <tuple>

#include "interflect/base/error.h"
#include "interflect/scene/rrv_parse.h"
#include "interflect/scene/scene_limits.h"

namespace interflect {

namespace {

using rrv::Definition;
using rrv::Document;
using rrv::Item;
using rrv::Part;

/// What an item becomes when everything in it is instanced. Saturates well below 2^64.
struct Cost {
  std::uint64_t triangles = 0;
  std::uint64_t steps = 0;  ///< items visited: objects of nothing but objects must not take forever either
  int depth = 0;

  void add(const Cost& inner) {
    constexpr std::uint64_t ceiling = std::uint64_t{1} << 40;
    triangles = std::min(ceiling, triangles + inner.triangles);
    steps = std::min(ceiling, steps + inner.steps);
    depth = std::max(depth, inner.depth + 1);
  }
};

/// Counts before anything is made, and finds objects that contain themselves.
class Counter {
 public:
  Counter(const Document& document, const std::string& file)
      : document_(document), file_(file), known_(document.definitions.size()), open_(document.definitions.size()) {}

  Cost items(const std::vector<Item>& list, int depth) {
    Cost cost;
    for (const Item& item : list) cost.add(one(item, depth));
    return cost;
  }

 private:
  Cost one(const Item& item, int depth) {
    Cost cost;
    cost.steps = 1;
    switch (item.kind) {
      case Item::Kind::part: cost.triangles = document_.parts[item.index].faces.size(); break;
      case Item::Kind::transform: cost.add(items(item.children, depth + 1)); break;
      case Item::Kind::reference: cost.add(definition(item, depth + 1)); break;
    }
    return cost;
  }

  Cost definition(const Item& item, int depth) {
    const Definition& d = document_.definitions[item.index];
    if (open_[item.index]) throw input_error(file_, item.line, fmt::format("object '{}' contains itself", d.name));
    if (depth > max_scene_depth) throw too_deep(item);
    if (!known_[item.index]) {
      open_[item.index] = true;
      known_[item.index] = items(d.items, depth);
      open_[item.index] = false;
    }
    if (depth + known_[item.index]->depth > 2 * max_scene_depth) throw too_deep(item);
    return *known_[item.index];
  }

  [[nodiscard]] Error too_deep(const Item& item) const {
    return input_error(file_, item.line, fmt::format("objects are nested more than {} deep", max_scene_depth));
  }

  const Document& document_;
  const std::string& file_;
  std::vector<std::optional<Cost>> known_;
  std::vector<bool> open_;
};

class Builder {
 public:
  Builder(const Document& document, const std::string& file) : document_(document), file_(file) {}

  Scene run() {
    const Cost cost = Counter(document_, file_).items(document_.body, 0);
    if (cost.triangles > max_scene_triangles || cost.steps > 2 * max_scene_triangles) {
      throw input_error(file_, 0,
                        fmt::format("more than {} triangles (or {} elements) once its objects are instanced",
                                    max_scene_triangles, 2 * max_scene_triangles));
    }
    if (cost.triangles == 0) throw input_error(file_, 0, "the scene's body holds no triangles");
    scene_.triangles.reserve(cost.triangles);
    scene_.materials = document_.materials;
    scene_.camera = document_.camera;
    scene_.warnings = document_.warnings;
    items(document_.body, Affine{}, "");
    return std::move(scene_);
  }

 private:
  void items(const std::vector<Item>& list, const Affine& map, const std::string& path) {
    for (const Item& item : list) {
      switch (item.kind) {
        case Item::Kind::part: part(item, map, path); break;
        case Item::Kind::transform: items(item.children, map * item.map, path); break;
        case Item::Kind::reference: {
          const Definition& d = document_.definitions[item.index];
          const bool fits = path.size() + 1 + d.name.size() <= max_scene_name;
          items(d.items, map, path.empty() ? d.name : fits ? fmt::format("{}/{}", path, d.name) : path);
          break;
        }
      }
    }
  }

  void part(const Item& item, const Affine& map, const std::string& path) {
    const Part& p = document_.parts[item.index];
    const auto base = static_cast<std::uint32_t>(scene_.positions.size());
    for (const Vec3 local : p.positions) {
      const Vec3 v = map.point(local);
      if (!(std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}) <= max_scene_coordinate)) {
        throw input_error(file_, item.line,
                          fmt::format("a vertex lies further out than {:g} (or is not finite)", max_scene_coordinate));
      }
      scene_.positions.push_back(v);
    }
    const bool mirrored = map.determinant() < 0;
    for (const Part::Face& face : p.faces) {
      Triangle t;
      t.vertex = {base + face.corner[0], base + face.corner[1], base + face.corner[2]};
      if (mirrored) std::swap(t.vertex[1], t.vertex[2]);
      t.surface = surface(path, p.name, face.material);
      t.line = face.line;
      scene_.triangles.push_back(t);
    }
  }

  std::uint32_t surface(const std::string& object, const std::string& group, std::uint32_t material) {
    // Neighbouring triangles mostly share their surface.
    if (!scene_.surfaces.empty()) {
      const Surface& last = scene_.surfaces[last_];
      if (last.material == material && last.object == object && last.group == group) return last_;
    }
    const auto next = static_cast<std::uint32_t>(scene_.surfaces.size());
    const auto [entry, added] = surfaces_.try_emplace({object, group, material}, next);
    if (added && next >= max_scene_surfaces) {
      throw input_error(file_, 0, fmt::format("more than {} combinations of object, group and material", next));
    }
    if (added) scene_.surfaces.push_back({object, group, material});
    return last_ = entry->second;
  }

  const Document& document_;
  const std::string& file_;
  Scene scene_;
  std::map<std::tuple<std::string, std::string, std::uint32_t>, std::uint32_t> surfaces_;
  std::uint32_t last_ = 0;
};

}  // namespace

Scene read_rrv_xml(const std::string& text, const std::filesystem::path& path) {
  const std::string file = path.string();
  constexpr std::size_t longest = std::size_t{1} << 30;  // the parsed tree can take 16 times as much
  if (text.size() > longest) throw input_error(file, 0, fmt::format("longer than {} bytes", longest));
  const Document document = rrv::parse(text, file);
  Scene scene = Builder(document, file).run();
  scene.name = path.stem().string();
  scene.file = file;
  return scene;
}

}  // namespace interflect
