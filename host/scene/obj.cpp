#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <unordered_map>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/scene/obj_material.h"
#include "interflect/scene/polygon.h"
#include "interflect/scene/scene.h"
#include "interflect/scene/statements.h"
#include "interflect/scene/text.h"

namespace interflect {

namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

/// A face as it stands in the file. Indices may point forward, so that faces are made when the whole file is read.
struct Face {
  std::size_t first;  ///< its corners: [first, the next face's first)
  std::uint32_t surface;
  std::uint32_t line;
};

struct Corner {
  std::uint32_t position;
  std::uint32_t uv;  ///< or none
};

/// The names in a file, numbered in order of appearance.
class Names {
 public:
  std::uint32_t index_of(std::string_view name) {
    const auto [entry, added] = index_.try_emplace(std::string(name), static_cast<std::uint32_t>(list_.size()));
    if (added) list_.emplace_back(name);
    return entry->second;
  }
  [[nodiscard]] const std::vector<std::string>& list() const { return list_; }

 private:
  std::unordered_map<std::string, std::uint32_t> index_;
  std::vector<std::string> list_;
};

class ObjReader {
 public:
  ObjReader(const std::string& text, const std::filesystem::path& path) : in_(text, path.string()), path_(path) {}
  Scene read();

 private:
  void statement();
  void read_vertex();
  void read_uv();
  void read_face();
  [[nodiscard]] std::uint32_t index(std::string_view digits, std::size_t count, std::string_view what) const;
  void read_camera();
  void read_libraries();
  bool read_library(std::string_view name);
  [[nodiscard]] std::uint32_t current_surface();
  void resolve_materials();
  void make_triangles();
  void check_corners(std::size_t first, std::size_t last, std::uint32_t line) const;
  void add_triangle(const Face& face, const std::array<std::uint32_t, 3>& corners);
  void warn(std::string text) { add_warning(scene_.warnings, std::move(text)); }

  Statements in_;
  std::filesystem::path path_;
  Scene scene_;
  std::vector<Vec2> uvs_;
  std::vector<Face> faces_;
  std::vector<Corner> corners_;
  Names objects_, groups_, materials_;
  std::uint32_t object_ = 0, group_ = 0;
  std::uint32_t material_ = none;                                   ///< until a usemtl, or a face that has none
  std::map<std::array<std::uint32_t, 3>, std::uint32_t> surfaces_;  ///< object, group, material
  MtlLibrary library_;
  std::set<std::string, std::less<>> libraries_seen_;
  std::map<std::string, std::uint64_t> ignored_;  ///< statements that are not supported
  std::uint64_t untextured_ = 0;                  ///< triangles of textured materials without texture coordinates
  std::uint64_t crossing_ = 0;                    ///< faces whose outline crosses itself
};

void ObjReader::read_vertex() {
  const double x = in_.number(), y = in_.number(), z = in_.number();
  if (scene_.positions.size() >= none - 1) in_.fail("more than 4 billion vertices");
  scene_.positions.push_back({x, y, z});  // a weight or colour behind them says nothing of a flat face
}

void ObjReader::read_uv() {
  const double u = in_.number(), v = in_.optional_number().value_or(0);
  if (uvs_.size() >= none - 1) in_.fail("more than 4 billion texture coordinates");
  uvs_.push_back({u, 1 - v});  // OBJ counts v from the bottom, Image from the top
}

std::uint32_t ObjReader::index(std::string_view digits, std::size_t count, std::string_view what) const {
  const std::int64_t value = in_.integer(digits);
  if (value == 0) in_.fail(fmt::format("{} index 0: indices start at 1", what));
  if (value < 0 && static_cast<std::uint64_t>(-(value + 1)) >= count) {
    in_.fail(fmt::format("{} index {} reaches before the first of the {} so far", what, value, count));
  }
  if (value >= none) in_.fail(fmt::format("{} index {} is out of range", what, value));
  return static_cast<std::uint32_t>(value > 0 ? value - 1 : static_cast<std::int64_t>(count) + value);
}

void ObjReader::read_face() {
  const Face face{corners_.size(), current_surface(), in_.line()};
  for (std::string_view word = in_.word(); !word.empty(); word = in_.word()) {
    const std::size_t slash = std::min(word.find('/'), word.size());
    Corner corner{index(word.substr(0, slash), scene_.positions.size(), "vertex"), none};
    if (slash < word.size()) {
      std::string_view rest = word.substr(slash + 1);
      const std::size_t second = std::min(rest.find('/'), rest.size());
      if (second > 0) corner.uv = index(rest.substr(0, second), uvs_.size(), "texture coordinate");
      if (second < rest.size() && in_.integer(rest.substr(second + 1)) == 0) in_.fail("normal index 0");
    }
    corners_.push_back(corner);
  }
  if (corners_.size() - face.first < 3) {
    in_.fail(fmt::format("a face of {} corners: at least 3 are needed", corners_.size() - face.first));
  }
  faces_.push_back(face);
}

std::uint32_t ObjReader::current_surface() {
  if (material_ == none) material_ = materials_.index_of("");
  const auto [entry, added] =
      surfaces_.try_emplace({object_, group_, material_}, static_cast<std::uint32_t>(scene_.surfaces.size()));
  if (added) scene_.surfaces.push_back({objects_.list()[object_], groups_.list()[group_], material_});
  return entry->second;
}

void ObjReader::read_camera() {
  Camera camera;
  bool eye = false, target = false;
  const auto point = [this] {
    const double x = in_.number(), y = in_.number(), z = in_.number();
    return Vec3{x, y, z};
  };
  for (std::string_view key = in_.word(); !key.empty(); key = in_.word()) {
    if (key == "eye") {
      camera.eye = point();
      eye = true;
    } else if (key == "target") {
      camera.target = point();
      target = true;
    } else if (key == "up") {
      camera.up = point();
    } else if (key == "fov") {
      const double degrees = in_.number();
      if (!(degrees > 0 && degrees < 180)) in_.fail("a camera's fov must lie between 0 and 180 degrees");
      camera.vertical_fov = degrees * std::numbers::pi / 180;
    } else {
      in_.fail(fmt::format("a camera has eye, target, up and fov, not '{}'", one_line(key)));
    }
  }
  if (!eye || !target) in_.fail("a camera needs 'eye X Y Z' and 'target X Y Z'");
  const Vec3 forward = normalized(camera.target - camera.eye);
  if (!(length(cross(forward, normalized(camera.up))) > 1e-9)) {
    in_.fail("a camera's target must differ from its eye, and its up must not point along the view");
  }
  if (!scene_.camera) scene_.camera = camera;
}

bool ObjReader::read_library(std::string_view name) {
  const std::filesystem::path file = find_beside(path_.parent_path(), name);
  if (file.empty()) return false;
  if (!libraries_seen_.insert(file.string()).second) return true;
  constexpr std::uintmax_t largest_library = std::uintmax_t{1} << 28;
  scene_.files.push_back(file);
  read_mtl(read_file(file, largest_library), file, library_, scene_.warnings);
  return true;
}

void ObjReader::read_libraries() {
  if (in_.rest().empty()) in_.fail("'mtllib' needs a file name");
  if (read_library(in_.rest())) return;  // one name, which may hold spaces
  for (std::string_view name = in_.word(); !name.empty(); name = in_.word()) {
    if (!read_library(name)) {
      warn(fmt::format("{}:{}: there is no material file '{}'", in_.file(), in_.line(), one_line(name)));
    }
  }
}

void ObjReader::statement() {
  const std::string_view key = in_.keyword();
  if (key == "v") {
    read_vertex();
  } else if (key == "vt") {
    read_uv();
  } else if (key == "f" || key == "fo") {
    read_face();
  } else if (key == "o") {
    object_ = objects_.index_of(in_.rest());
  } else if (key == "g") {
    group_ = groups_.index_of(in_.rest());
  } else if (key == "usemtl") {
    material_ = materials_.index_of(in_.rest());
  } else if (key == "mtllib") {
    read_libraries();
  } else if (key == "#camera") {
    read_camera();
  } else if (key != "vn" && key != "s" && ignored_.size() < 20) {
    ++ignored_[one_line(key)];
  }
}

void ObjReader::resolve_materials() {
  std::map<std::string, int> images;
  std::vector<char> used(materials_.list().size());
  for (const Surface& surface : scene_.surfaces) used[surface.material] = 1;
  for (std::size_t i = 0; i < materials_.list().size(); ++i) {
    Material material;
    material.name = materials_.list()[i];
    material.reflectance = {default_reflectance, default_reflectance, default_reflectance};
    const auto found = library_.find(material.name);
    if (found != library_.end() && used[i]) {
      const MtlMaterial& mtl = found->second;
      material.reflectance = mtl.reflectance;
      material.emittance = mtl.emittance;
      material.reflectance_image = load_texture(mtl, mtl.reflectance_image, images, scene_);
      material.emittance_image = load_texture(mtl, mtl.emittance_image, images, scene_);
    } else if (used[i]) {
      const std::string what = material.name.empty()
                                   ? "there are faces without a material"
                                   : fmt::format("no material file defines '{}'", one_line(material.name));
      warn(fmt::format("{}: {}: reflectance {} is taken", in_.file(), what, default_reflectance));
    }
    scene_.materials.push_back(std::move(material));
  }
}

void ObjReader::check_corners(std::size_t first, std::size_t last, std::uint32_t line) const {
  for (std::size_t i = first; i < last; ++i) {
    const Corner corner = corners_[i];
    const auto fail = [&](const char* what, std::uint32_t index, std::size_t count) {
      throw input_error(in_.file(), line, fmt::format("{} {} does not exist: there are {}", what, index + 1, count));
    };
    if (corner.position >= scene_.positions.size()) fail("vertex", corner.position, scene_.positions.size());
    if (corner.uv != none && corner.uv >= uvs_.size()) fail("texture coordinate", corner.uv, uvs_.size());
  }
}

void ObjReader::add_triangle(const Face& face, const std::array<std::uint32_t, 3>& corners) {
  Triangle t{{}, face.surface, face.line, -1};
  bool has_uvs = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const Corner corner = corners_[face.first + corners[k]];
    t.vertex[k] = corner.position;
    has_uvs = has_uvs && corner.uv != none;
  }
  const Material& material = scene_.materials[scene_.surfaces[face.surface].material];
  if (material.reflectance_image >= 0 || material.emittance_image >= 0) {
    if (has_uvs) {
      t.uv = static_cast<std::int64_t>(scene_.uvs.size());
      for (const std::uint32_t k : corners) scene_.uvs.push_back(uvs_[corners_[face.first + k].uv]);
    } else {
      ++untextured_;
    }
  }
  scene_.triangles.push_back(t);
}

void ObjReader::make_triangles() {
  std::vector<Vec3> outline;
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const Face& face = faces_[f];
    const std::size_t last = f + 1 < faces_.size() ? faces_[f + 1].first : corners_.size();
    check_corners(face.first, last, face.line);
    outline.clear();
    for (std::size_t i = face.first; i < last; ++i) outline.push_back(scene_.positions[corners_[i].position]);
    Triangulation cut;
    try {
      cut = triangulate(outline);
    } catch (const Error& error) {
      throw input_error(in_.file(), face.line, error.what());
    }
    if (!cut.simple && crossing_++ == 0) {
      warn(fmt::format("{}:{}: a face whose outline crosses itself", in_.file(), face.line));
    }
    for (const auto& corners : cut.triangles) add_triangle(face, corners);
  }
}

Scene ObjReader::read() {
  // The names before any statement gives one.
  objects_.index_of("");
  groups_.index_of("");
  while (in_.next()) statement();
  if (faces_.empty()) throw input_error(in_.file(), 0, "holds no faces");
  resolve_materials();
  make_triangles();
  for (const auto& [keyword, count] : ignored_) {
    warn(fmt::format("{}: '{}' statements are ignored: {}", in_.file(), keyword, count));
  }
  if (crossing_ > 1) warn(fmt::format("{}: faces whose outline crosses itself: {}", in_.file(), crossing_));
  if (untextured_ > 0) {
    warn(fmt::format("{}: triangles of textured materials without texture coordinates: {}", in_.file(), untextured_));
  }
  return std::move(scene_);
}

}  // namespace

Scene read_obj(const std::string& text, const std::filesystem::path& path) {
  Scene scene = ObjReader(text, path).read();
  scene.name = path.stem().string();
  scene.file = path.string();
  return scene;
}

}  // namespace interflect
