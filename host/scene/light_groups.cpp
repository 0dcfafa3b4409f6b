#include "interflect/scene/light_groups.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr std::size_t most_by_itself = 24;  // groups that `auto` makes

bool emits(const PatchMesh& mesh, std::size_t i) {
  return std::any_of(mesh.emittance[i].begin(), mesh.emittance[i].end(), [](double e) { return e != 0; });
}

std::string material_of(const Scene& scene, const Surface& surface) {
  return surface.material < scene.materials.size() ? scene.materials[surface.material].name : std::string{};
}

/// The name of a surface by which `object` tells lamps apart.
std::string object_of(const Scene& scene, const Surface& surface) {
  if (!surface.object.empty()) return surface.object;
  return surface.group.empty() ? material_of(scene, surface) : surface.group;
}

/// On one line, and not empty.
std::string readable(std::string name) {
  for (char& c : name) c = std::iscntrl(static_cast<unsigned char>(c)) != 0 ? ' ' : c;
  const bool blank = std::all_of(name.begin(), name.end(), [](char c) { return c == ' '; });
  return blank ? "light" : name;
}

void make_readable(std::vector<std::string>& names) {
  std::set<std::string> taken;
  for (std::string& name : names) {
    name = readable(std::move(name));
    const std::string base = name;
    for (int k = 2; !taken.insert(name).second; ++k) name = fmt::format("{} ({})", base, k);
  }
}

/// Groups of what `key` calls alike. Stops short of more than `most`.
template <class Key>
std::optional<LightGroups> groups_by(const PatchMesh& mesh, std::size_t most, const Key& key) {
  LightGroups groups;
  groups.of_patch.assign(mesh.size(), LightGroups::none);
  std::map<std::string, std::uint32_t> index;
  std::vector<std::uint32_t> of_surface(mesh.surfaces.size(), LightGroups::none);
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (!emits(mesh, i)) continue;
    std::uint32_t& group = of_surface[mesh.surface[i]];
    if (group == LightGroups::none) {
      const std::string name = key(mesh.surfaces[mesh.surface[i]]);
      const auto [entry, added] = index.try_emplace(name, static_cast<std::uint32_t>(groups.names.size()));
      if (added && groups.names.size() == most) return std::nullopt;
      if (added) groups.names.push_back(name);
      group = entry->second;
    }
    groups.of_patch[i] = group;
  }
  make_readable(groups.names);
  return groups;
}

/// The classical match with one place to return to: linear in the text for every star.
bool matches(std::string_view pattern, std::string_view text) {
  std::size_t p = 0, t = 0, star = std::string_view::npos, from = 0;
  while (t < text.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      from = t;
    } else if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == text[t])) {
      ++p;
      ++t;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      t = ++from;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t begin = 0;;) {
    const std::size_t end = text.find(separator, begin);
    parts.push_back(text.substr(begin, end == std::string_view::npos ? end : end - begin));
    if (end == std::string_view::npos) return parts;
    begin = end + 1;
  }
}

Error usage(std::string_view list, std::string_view cause) {
  return {ErrorKind::usage, fmt::format("--light-groups: '{}': {}", list, cause)};
}

/// What a list asks for: a name, and the patterns of its emitters.
struct Wanted {
  std::string name;
  std::vector<std::string_view> patterns;
};

std::vector<Wanted> parse(std::string_view list) {
  std::vector<Wanted> wanted;
  if (list.find('=') == std::string_view::npos) {
    if (list.find(';') != std::string_view::npos) throw usage(list, "';' parts groups that have a name: NAME=PATTERN");
    for (const std::string_view pattern : split(list, ',')) wanted.push_back({std::string(pattern), {pattern}});
  } else {
    for (const std::string_view group : split(list, ';')) {
      const std::size_t equals = group.find('=');
      if (equals == std::string_view::npos) throw usage(list, fmt::format("'{}' is not NAME=PATTERN,...", group));
      wanted.push_back({std::string(group.substr(0, equals)), split(group.substr(equals + 1), ',')});
    }
  }
  std::set<std::string_view> names;
  for (const Wanted& group : wanted) {
    if (group.name.empty()) throw usage(list, "a group without a name");
    if (std::any_of(group.patterns.begin(), group.patterns.end(), [](std::string_view p) { return p.empty(); })) {
      throw usage(list, fmt::format("group '{}' has an empty pattern", group.name));
    }
    if (!names.insert(group.name).second) throw usage(list, fmt::format("'{}' is there twice", group.name));
  }
  return wanted;
}

/// The surfaces that emit, in the order of their first patch.
std::vector<std::uint32_t> emitting_surfaces(const PatchMesh& mesh) {
  std::vector<bool> seen(mesh.surfaces.size());
  std::vector<std::uint32_t> surfaces;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const std::uint32_t s = mesh.surface[i];
    if (seen[s] || !emits(mesh, i)) continue;
    seen[s] = true;
    surfaces.push_back(s);
  }
  return surfaces;
}

/// "the emitters are a, b, c and 12 more"
std::string emitters_line(const Scene& scene, const PatchMesh& mesh, const std::vector<std::uint32_t>& surfaces) {
  constexpr std::size_t most = 20;
  std::vector<std::string> names;
  for (const std::uint32_t s : surfaces) {
    const Surface& surface = mesh.surfaces[s];
    const std::string object = readable(object_of(scene, surface)), material = readable(material_of(scene, surface));
    const std::string name = object == material ? object : fmt::format("{} (material {})", object, material);
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  if (names.empty()) return "nothing emits in this scene";
  const std::size_t shown = std::min(names.size(), most);
  return fmt::format("the emitters are {}{}", fmt::join(names.begin(), names.begin() + std::ptrdiff_t(shown), ", "),
                     shown < names.size() ? fmt::format(" and {} more", names.size() - shown) : "");
}

LightGroups groups_of_list(const Scene& scene, const PatchMesh& mesh, std::string_view list) {
  const std::vector<Wanted> wanted = parse(list);
  const std::vector<std::uint32_t> emitting = emitting_surfaces(mesh);
  if (wanted.size() + 1 > most_light_groups) {
    throw Error(ErrorKind::limit,
                fmt::format("--light-groups: {} groups, {} are the most", wanted.size() + 1, most_light_groups));
  }
  LightGroups groups;
  std::vector<std::uint32_t> of_surface(mesh.surfaces.size(), LightGroups::none);
  for (const Wanted& group : wanted) {
    const auto number = static_cast<std::uint32_t>(groups.names.size());
    bool any = false;
    for (const std::string_view pattern : group.patterns) {
      bool found = false;
      for (const std::uint32_t s : emitting) {
        const Surface& surface = mesh.surfaces[s];
        if (!matches(pattern, surface.object) && !matches(pattern, surface.group) &&
            !matches(pattern, material_of(scene, surface))) {
          continue;
        }
        found = true;
        if (of_surface[s] == LightGroups::none) of_surface[s] = number;
        any = any || of_surface[s] == number;
      }
      if (!found) {
        throw usage(list, fmt::format("no emitter is called '{}'; {}", pattern, emitters_line(scene, mesh, emitting)));
      }
    }
    if (!any) throw usage(list, fmt::format("all that '{}' takes is in groups before it", group.name));
    groups.names.push_back(group.name);
  }
  const auto rest = static_cast<std::uint32_t>(groups.names.size());
  bool left = false;
  for (const std::uint32_t s : emitting) {
    if (of_surface[s] != LightGroups::none) continue;
    of_surface[s] = rest;
    left = true;
  }
  if (left) groups.names.emplace_back("other lights");
  groups.of_patch.assign(mesh.size(), LightGroups::none);
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (emits(mesh, i)) groups.of_patch[i] = of_surface[mesh.surface[i]];
  }
  make_readable(groups.names);
  return groups;
}

}  // namespace

LightGroups light_groups(const Scene& scene, const PatchMesh& mesh, std::string_view by) {
  LightGroups none;
  none.of_patch.assign(mesh.size(), LightGroups::none);
  const auto of_object = [&](const Surface& surface) { return object_of(scene, surface); };
  const auto of_material = [&](const Surface& surface) { return material_of(scene, surface); };
  if (by == "none") return none;
  if (by == "auto") {
    if (auto groups = groups_by(mesh, most_by_itself, of_object)) return *groups;
    return groups_by(mesh, most_by_itself, of_material).value_or(none);
  }
  if (by != "object" && by != "material") return groups_of_list(scene, mesh, by);
  auto groups =
      by == "object" ? groups_by(mesh, most_light_groups, of_object) : groups_by(mesh, most_light_groups, of_material);
  if (groups) return *groups;
  throw Error(ErrorKind::limit, fmt::format("--light-groups {}: more than {} groups; name those that matter in a list",
                                            by, most_light_groups));
}

}  // namespace interflect
