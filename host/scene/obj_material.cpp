#include "interflect/scene/obj_material.h"

#include <fmt/format.h>
#include <tiny_obj_loader.h>

#include <algorithm>
#include <optional>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/scene/png_texture.h"
#include "interflect/scene/statements.h"
#include "interflect/scene/text.h"

namespace interflect {

namespace {

/// A material while it is read: what the file did not say is still open.
struct Draft {
  std::string name;
  std::uint32_t line = 0;
  std::optional<Rgb> diffuse, emission;
  std::string diffuse_image, emission_image;
  std::optional<double> opacity;
};

Rgb read_colour(Statements& in) {
  const double r = in.number();
  const std::optional<double> g = in.optional_number();
  return {r, g.value_or(r), g ? in.number() : r};
}

/// The file name behind the options of a map statement, which tinyobjloader knows how to skip.
std::string read_map(Statements& in, std::vector<std::string>& warnings) {
  tinyobj::texture_option_t options{};
  std::string name;
  const std::string rest(in.rest());
  if (rest.empty() || !tinyobj::ParseTextureNameAndOption(&name, &options, rest.c_str())) {
    in.fail(fmt::format("'{}' needs a file name", in.keyword()));
  }
  if (rest.starts_with('-')) {
    add_warning(warnings, fmt::format("{}:{}: texture options are ignored", in.file(), in.line()));
  }
  return name;
}

void finish(Draft& draft, const std::filesystem::path& path, MtlLibrary& library, std::vector<std::string>& warnings) {
  if (draft.line == 0) return;
  const auto warn = [&](std::string_view what) {
    add_warning(warnings, fmt::format("{}:{}: material '{}' {}", one_line(path.string()), draft.line,
                                      one_line(draft.name), what));
  };
  const auto grey = [](double v) { return Rgb{v, v, v}; };
  MtlMaterial material;
  if (!draft.diffuse && draft.diffuse_image.empty() && !draft.emission) {
    warn(fmt::format("has no Kd: reflectance {} is taken", default_reflectance));
  }
  if (draft.opacity && *draft.opacity < 1) warn("is transparent; it is taken as opaque");
  const double undefined = !draft.diffuse_image.empty() ? 1 : draft.emission ? 0 : default_reflectance;
  material.reflectance = draft.diffuse.value_or(grey(undefined));
  material.emittance = draft.emission.value_or(grey(draft.emission_image.empty() ? 0 : 1));
  material.reflectance_image = draft.diffuse_image;
  material.emittance_image = draft.emission_image;
  material.folder = path.parent_path();
  if (!library.emplace(draft.name, std::move(material)).second) warn("is defined twice; the first one counts");
}

Image read_image(const std::filesystem::path& file, std::vector<std::string>& warnings) {
  constexpr std::uintmax_t largest_image = std::uintmax_t{1} << 28;
  const std::string bytes = read_file(file, largest_image);
  if (is_png(bytes)) return decode_png(bytes, file.string());
  add_warning(warnings, fmt::format("{}: only PNG textures are read; this one is ignored", one_line(file.string())));
  return {};
}

}  // namespace

void add_warning(std::vector<std::string>& warnings, std::string line) {
  constexpr std::size_t most = 50;
  if (warnings.size() < most) {
    warnings.push_back(std::move(line));
  } else if (warnings.size() == most) {
    warnings.emplace_back("more warnings of this kind are left out");
  }
}

std::filesystem::path find_beside(const std::filesystem::path& folder, std::string_view name) {
  std::string slashes(name);
  std::replace(slashes.begin(), slashes.end(), '\\', '/');
  for (const std::string& candidate : {std::string(name), slashes}) {
    std::filesystem::path path = folder / candidate;
    std::error_code ignored;  // a name that is too long, a folder that may not be entered: not there
    if (std::filesystem::is_regular_file(path, ignored)) return path;
  }
  return {};
}

void read_mtl(std::string_view text, const std::filesystem::path& path, MtlLibrary& library,
              std::vector<std::string>& warnings) {
  Statements in(text, path.string());
  Draft draft;
  while (in.next()) {
    const std::string_view key = in.keyword();
    if (key == "newmtl") {
      finish(draft, path, library, warnings);
      draft = {};
      draft.name = in.rest();
      draft.line = in.line();
    } else if (key == "Kd") {
      draft.diffuse = read_colour(in);
    } else if (key == "Ke") {
      draft.emission = read_colour(in);
    } else if (key == "map_Kd") {
      draft.diffuse_image = read_map(in, warnings);
    } else if (key == "map_Ke") {
      draft.emission_image = read_map(in, warnings);
    } else if (key == "d" && in.rest().find_first_not_of("0123456789.") == std::string_view::npos) {
      draft.opacity = in.number();
    }  // the rest of MTL says nothing of diffuse light
  }
  finish(draft, path, library, warnings);
}

int load_texture(const MtlMaterial& material, const std::string& name, std::map<std::string, int>& seen, Scene& scene) {
  if (name.empty()) return -1;
  const std::filesystem::path file = find_beside(material.folder, name);
  if (file.empty()) {
    const std::string path = (material.folder / name).string();
    add_warning(scene.warnings, fmt::format("{}: there is no such texture; it is ignored", one_line(path)));
    return -1;
  }
  const auto [entry, added] = seen.try_emplace(file.string(), -1);
  if (!added) return entry->second;
  scene.files.push_back(file);
  Image image = read_image(file, scene.warnings);
  if (image.pixels.empty()) return -1;
  scene.images.push_back(std::move(image));
  return entry->second = static_cast<int>(scene.images.size()) - 1;
}

}  // namespace interflect
