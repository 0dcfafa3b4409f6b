#include "interflect/scene/text.h"

#include <fmt/format.h>

namespace interflect {

std::string one_line(std::string_view text) {
  constexpr std::size_t longest = 100;
  std::string out(text.substr(0, longest));
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  if (text.size() > longest) out += "...";
  return out;
}

std::string place_of(const Scene& scene, std::size_t triangle) {
  const Triangle& t = scene.triangles[triangle];
  const Surface& surface = scene.surfaces[t.surface];
  std::string names;
  if (!surface.object.empty()) names = fmt::format("object '{}'", one_line(surface.object));
  if (!surface.group.empty()) {
    names += fmt::format("{}group '{}'", names.empty() ? "" : ", ", one_line(surface.group));
  }
  const std::string place = t.line > 0 ? fmt::format("line {}", t.line)
                                       : fmt::format("triangle {} of {}", triangle + 1, scene.triangles.size());
  return names.empty() ? place : fmt::format("{} ({})", place, names);
}

}  // namespace interflect
