#include "interflect/scene/rrv_parse.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <numbers>
#include <unordered_map>
#include <utility>

#include "interflect/scene/rrv_attributes.h"
#include "interflect/scene/scene_limits.h"

namespace interflect::rrv {

namespace {

/// Reflectivity and emission as they pass from a triangleset to its triangles.
struct Look {
  Vec3 reflectivity{}, emission{};
};

std::optional<Primitive> primitive_named(std::string_view tag) {
  if (tag == "cuboid") return Primitive::cuboid;
  if (tag == "barrel") return Primitive::barrel;
  if (tag == "globe") return Primitive::globe;
  if (tag == "teapot") return Primitive::teapot;
  return std::nullopt;
}

/// rrv's rotation: the angle is shared out to the axes in proportion to the unit vector (dx, dy, dz), and the three
/// parts are applied about z, then y, then x. About one axis this is a plain rotation, right-handed about x and z and
/// left-handed about y; rrv's scenes count on it.
Affine rotation(double angle, Vec3 axis) {
  const Vec3 part = normalized(axis) * angle;
  const auto [cx, sx] = cos_sin_degrees(part.x);
  const auto [cy, sy] = cos_sin_degrees(part.y);
  const auto [cz, sz] = cos_sin_degrees(part.z);
  const Affine about_x{{1, 0, 0}, {0, cx, sx}, {0, -sx, cx}, {}};
  const Affine about_y{{cy, 0, sy}, {0, 1, 0}, {-sy, 0, cy}, {}};
  const Affine about_z{{cz, sz, 0}, {-sz, cz, 0}, {0, 0, 1}, {}};
  return about_x * (about_y * about_z);
}

class Parser {
 public:
  Parser(const std::string& text, const std::string& file) : source_(text, file) {
    const pugi::xml_parse_result result = xml_.load_buffer(text.data(), text.size());
    if (!result)
      throw input_error(file, source_.line_at(result.offset), fmt::format("not XML: {}", result.description()));
  }

  Document run() {
    const pugi::xml_node root = xml_.document_element();
    if (std::string_view(root.name()) != "scene") {
      throw source_.error(root, fmt::format("the root element is <{}>, not <scene>", root.name()));
    }
    pugi::xml_node body;
    for (const pugi::xml_node child : root.children()) {
      const std::string_view tag = child.name();
      if (tag == "head") collect_definitions(child);
      if (tag == "camera") read_camera(child);
      if (tag == "body") {
        if (body) source_.warn(child, "a second <body> is ignored");
        if (!body) body = child;
      }
      if (tag != "head" && tag != "camera" && tag != "body") ignore(child);
    }
    if (!body) throw source_.error(root, "<scene> has no <body>");
    for (std::size_t i = 0; i < nodes_.size(); ++i) document_.definitions[i].items = items(nodes_[i], 0);
    document_.body = items(body, 0);
    document_.warnings = source_.warnings();
    return std::move(document_);
  }

 private:
  void ignore(pugi::xml_node node) {
    if (node.type() == pugi::node_element)
      source_.warn(node, fmt::format("<{}> is not known here, ignored", node.name()));
  }

  void collect_definitions(pugi::xml_node head) {
    for (const pugi::xml_node node : head.children()) {
      if (std::string_view(node.name()) != "objectdef") {
        ignore(node);
        continue;
      }
      const std::string key = node.attribute("name").value();
      if (key.empty()) throw source_.error(node, "<objectdef> has no attribute 'name'");
      if (node.attribute("file")) {
        throw source_.error(node, fmt::format("object '{}' is in another file, which is not supported", key));
      }
      if (!definition_.try_emplace(key, nodes_.size()).second) {
        source_.warn(node, fmt::format("object '{}' is defined twice, the first is taken", key));
        continue;
      }
      document_.definitions.push_back({name(node), source_.line(node), {}});
      nodes_.push_back(node);
    }
  }

  // The depth bounds the recursion here and in whoever walks the items.
  std::vector<Item> items(pugi::xml_node parent, int depth) {
    if (depth >= max_scene_depth) {
      throw source_.error(parent, fmt::format("elements are nested more than {} deep", max_scene_depth));
    }
    std::vector<Item> list;
    for (const pugi::xml_node node : parent.children()) {
      if (node.type() != pugi::node_element) continue;
      const std::string_view tag = node.name();
      Item item;
      item.line = source_.line(node);
      if (tag == "object") {
        item.kind = Item::Kind::reference;
        item.index = definition(node);
      } else if (tag == "triangleset" || primitive_named(tag)) {
        item.kind = Item::Kind::part;
        item.index = document_.parts.size();
        document_.parts.push_back(tag == "triangleset" ? triangle_set(node) : solid(node, *primitive_named(tag)));
      } else if (const std::optional<Affine> map = transform(node)) {
        item.map = *map;
        item.children = items(node, depth + 1);
      } else {
        ignore(node);
        continue;
      }
      list.push_back(std::move(item));
    }
    return list;
  }

  std::size_t definition(pugi::xml_node node) {
    const std::string key = node.attribute("name").value();
    if (key.empty()) throw source_.error(node, "<object> has no attribute 'name'");
    const auto found = definition_.find(key);
    if (found == definition_.end()) throw source_.error(node, fmt::format("object '{}' is not defined", key));
    return found->second;
  }

  std::optional<Affine> transform(pugi::xml_node node) {
    const std::string_view tag = node.name();
    if (tag != "translate" && tag != "scale" && tag != "rotate" && tag != "shear") return std::nullopt;
    const Vec3 by{number(source_, node, "dx", 0), number(source_, node, "dy", 0), number(source_, node, "dz", 0)};
    if (tag == "translate") return translation(by);
    if (tag == "scale") {
      if (by.x == 0 || by.y == 0 || by.z == 0) source_.warn(node, "a scale of 0 (also where dx, dy or dz is missing)");
      return scaling(by);
    }
    if (tag == "shear") {
      source_.warn(node, "<shear> does nothing, as in rrv");
      return Affine{};
    }
    const double angle = number(source_, node, "angle", 0);
    if (angle != 0 && !(length(by) > 0)) throw source_.error(node, "<rotate> has no axis: dx, dy and dz are 0");
    return rotation(angle, by);
  }

  Look look(pugi::xml_node node, const Look& inherited) {
    Look own = inherited;
    if (const auto reflectivity = triple(source_, node, "reflectivity")) own.reflectivity = *reflectivity;
    if (const auto emission = triple(source_, node, "emission")) own.emission = *emission;
    (void)triple(source_, node, "radiosity");  // the result of an earlier solution: checked, not used
    if (std::min({own.emission.x, own.emission.y, own.emission.z}) < 0) {
      throw source_.error(node, fmt::format("<{}> emission is negative", node.name()));
    }
    return own;
  }

  std::uint32_t material(const Look& l) {
    const std::array<double, 6> key{l.reflectivity.x, l.reflectivity.y, l.reflectivity.z,
                                    l.emission.x,     l.emission.y,     l.emission.z};
    const auto [entry, added] = material_.try_emplace(key, static_cast<std::uint32_t>(document_.materials.size()));
    if (added) {
      Material m;
      m.reflectance = {key[0], key[1], key[2]};
      m.emittance = {key[3], key[4], key[5]};
      m.name = fmt::format("reflectivity {},{},{}", key[0], key[1], key[2]);
      if (l.emission != Vec3{}) m.name += fmt::format(" emission {},{},{}", key[3], key[4], key[5]);
      document_.materials.push_back(std::move(m));
    }
    return entry->second;
  }

  void count_triangles(pugi::xml_node node, std::uint64_t more) {
    triangles_ += more;
    if (triangles_ > max_scene_triangles) {
      throw source_.error(node, fmt::format("more than {} triangles", max_scene_triangles));
    }
  }

  Vec3 vertex(pugi::xml_node node) {
    return {number(source_, node, "x"), number(source_, node, "y"), number(source_, node, "z")};
  }

  std::vector<Vec3> vertices(pugi::xml_node node, std::size_t wanted) {
    std::vector<Vec3> list;
    for (const pugi::xml_node child : node.children()) {
      if (child.type() != pugi::node_element) continue;
      if (std::string_view(child.name()) != "vertex") {
        ignore(child);
      } else if (list.size() < wanted) {
        list.push_back(vertex(child));
      } else {
        throw source_.error(child, fmt::format("<{}> has more than {} <vertex>", node.name(), wanted));
      }
    }
    if (list.size() < wanted) {
      throw source_.error(node, fmt::format("<{}> has {} <vertex>, not {}", node.name(), list.size(), wanted));
    }
    return list;
  }

  /// As an OpenGL triangle strip: each trianglenext adds a vertex, and every other triangle runs the other way round.
  Part triangle_set(pugi::xml_node set) {
    Part part;
    part.name = name(set);
    const Look base = look(set, {});
    Look current = base;
    Part::Face face;
    bool started = false, odd = false;
    for (const pugi::xml_node node : set.children()) {
      if (node.type() != pugi::node_element) continue;
      const bool first = std::string_view(node.name()) == "triangle";
      if (!first && std::string_view(node.name()) != "trianglenext") {
        ignore(node);
        continue;
      }
      if (!first && !started) throw source_.error(node, "<trianglenext> has no <triangle> before it");
      count_triangles(node, 1);
      const std::vector<Vec3> added = vertices(node, first ? 3 : 1);
      part.positions.insert(part.positions.end(), added.begin(), added.end());
      const auto last = static_cast<std::uint32_t>(part.positions.size() - 1);
      started = true;
      odd = !first && !odd;
      current = look(node, first ? base : current);
      face.corner = odd ? std::array<std::uint32_t, 3>{last - 1, last - 2, last}
                        : std::array<std::uint32_t, 3>{last - 2, last - 1, last};
      face.line = source_.line(node);
      face.material = material(current);
      part.faces.push_back(face);
    }
    return part;
  }

  Part solid(pugi::xml_node node, Primitive primitive) {
    const DivisionRange range = division_range(primitive);
    const double wanted = number(source_, node, "division", range.usual);
    if (wanted < range.least || wanted > range.most || wanted != std::floor(wanted)) {
      throw source_.error(node, fmt::format("<{}> division {} is not a whole number from {} to {}", node.name(), wanted,
                                            range.least, range.most));
    }
    const auto division = static_cast<int>(wanted);
    count_triangles(node, primitive_triangles(primitive, division));
    const auto [made, missing] = made_.try_emplace({primitive, division});
    if (missing) made->second = make_primitive(primitive, division);
    const SurfaceMesh& mesh = made->second;
    Part part;
    part.name = name(node);
    part.positions = mesh.positions;
    const std::uint32_t of = material(look(node, {}));
    for (const auto& corner : mesh.triangles) part.faces.push_back({corner, of, source_.line(node)});
    return part;
  }

  void read_camera(pugi::xml_node node) {
    if (document_.camera) {
      source_.warn(node, "a second <camera> is ignored");
      return;
    }
    Camera camera;
    const std::optional<Vec3> eye = triple(source_, node, "eye"), target = triple(source_, node, "target");
    if (!eye || !target) throw source_.error(node, "<camera> needs the attributes 'eye' and 'target'");
    camera.eye = *eye;
    camera.target = *target;
    camera.up = triple(source_, node, "up").value_or(camera.up);
    const double degrees = number(source_, node, "fov", camera.vertical_fov * 180 / std::numbers::pi);
    if (degrees <= 0 || degrees >= 180) throw source_.error(node, "<camera> fov is not between 0 and 180 degrees");
    camera.vertical_fov = degrees * std::numbers::pi / 180;
    const Vec3 view = normalized(camera.target - camera.eye);
    if (!(length(cross(view, normalized(camera.up))) > 1e-9)) {
      throw source_.error(node, "<camera> eye and target coincide, or it looks along 'up'");
    }
    document_.camera = camera;
  }

  Source source_;
  pugi::xml_document xml_;
  Document document_;
  std::unordered_map<std::string, std::size_t> definition_;
  std::vector<pugi::xml_node> nodes_;  // one per definition
  std::map<std::array<double, 6>, std::uint32_t> material_;
  std::map<std::pair<Primitive, int>, SurfaceMesh> made_;
  std::uint64_t triangles_ = 0;
};

}  // namespace

Document parse(const std::string& text, const std::string& file) {
  return Parser(text, file).run();
}

}  // namespace interflect::rrv
