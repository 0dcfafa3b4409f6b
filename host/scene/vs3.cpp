#include <fmt/format.h>

#include <algorithm>
#include <compare>
#include <map>
#include <set>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/scene/convex.h"
#include "interflect/scene/obj_material.h"
#include "interflect/scene/scene.h"
#include "interflect/scene/scene_limits.h"
#include "interflect/scene/text.h"
#include "interflect/scene/vs3_records.h"

namespace interflect {

namespace {

using vs3::File;
using Kind = vs3::Surface::Kind;

// View3D's own bounds: how far a subsurface may lie off its base's plane and beyond its sides, as a share of its
// radius, and the least cosine between their normals.
constexpr double off_base = 1e-5, same_direction = 0.999;
// The time for the cuts grows with the square of it.
constexpr std::size_t most_on_one_base = 2048;

/// A name for each surface, as its record has it; the number is added where another surface has the name already.
std::vector<std::string> unique_names(const std::vector<vs3::Surface>& surfaces) {
  std::set<std::string> taken;
  std::vector<std::string> names(surfaces.size());
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    if (surfaces[i].kind != Kind::radiating) continue;
    if (!surfaces[i].name.empty() && taken.insert(surfaces[i].name).second) names[i] = surfaces[i].name;
  }
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    if (!names[i].empty()) continue;
    const bool blocks = surfaces[i].kind == Kind::obstruction;
    names[i] = fmt::format("{}#{}",
                           blocks                     ? "obstruction"
                           : surfaces[i].name.empty() ? "surface"
                                                      : surfaces[i].name,
                           i + 1);
    while (!taken.insert(names[i]).second) names[i] += fmt::format("#{}", i + 1);
  }
  return names;
}

/// What decides on a surface's material.
struct Look {
  enum class Kind { radiating, obstruction, back };
  Kind kind;
  double emittance;
  auto operator<=>(const Look&) const = default;
};

class Builder {
 public:
  Builder(File file, std::string path)
      : surfaces_(std::move(file.surfaces)),
        path_(std::move(path)),
        names_(unique_names(surfaces_)),
        on_(surfaces_.size()) {
    scene_.warnings = std::move(file.warnings);
  }

  Scene run() {
    for (std::size_t i = 0; i < surfaces_.size(); ++i) {
      if (surfaces_[i].base > 0) place_on_base(i);
    }
    std::uint64_t masks = 0, renamed = 0;
    for (std::size_t i = 0; i < surfaces_.size(); ++i) {
      const vs3::Surface& s = surfaces_[i];
      if (s.kind == Kind::mask && masks++ == 0) {
        warn(fmt::format("{}:{}: a mask and what it covers see only each other: both are left out", path_, s.line));
      }
      if (s.kind == Kind::radiating && !s.name.empty() && names_[i] != s.name && renamed++ == 0) {
        warn(fmt::format("{}:{}: another surface is called '{}': this one becomes '{}'", path_, s.line,
                         one_line(s.name), one_line(names_[i])));
      }
      if (s.kind == Kind::radiating || s.kind == Kind::obstruction) add(i);
    }
    if (masks > 1) warn(fmt::format("{}: masks left out: {}", path_, masks));
    if (renamed > 1) warn(fmt::format("{}: surfaces with another one's name: {}", path_, renamed));
    if (scene_.triangles.empty()) throw input_error(path_, 0, "nothing is left of its surfaces");
    return std::move(scene_);
  }

 private:
  void place_on_base(std::size_t i);
  void add(std::size_t i);
  [[nodiscard]] std::vector<Outline> pieces(std::size_t i) const;
  void add_pieces(const std::vector<Outline>& pieces, std::uint32_t line);
  std::uint32_t material(const Look& look);
  void warn(std::string text) { add_warning(scene_.warnings, std::move(text)); }

  std::vector<vs3::Surface> surfaces_;
  std::string path_;
  std::vector<std::string> names_;
  std::vector<std::vector<std::size_t>> on_;  ///< the surfaces whose base each one is
  Scene scene_;
  std::map<Look, std::uint32_t> materials_;
};

void Builder::place_on_base(std::size_t i) {
  const vs3::Surface& s = surfaces_[i];
  const vs3::Surface& base = surfaces_[s.base - 1];
  const auto fail = [&](std::string_view cause) {
    throw input_error(path_, s.line, fmt::format("surface {} {} base surface {}", i + 1, cause, s.base));
  };
  const double slack = off_base * s.radius;
  if (distance_from_plane(s.outline, base.middle, base.normal) > slack) fail("does not lie in the plane of its");
  const bool along = s.kind == Kind::radiating;
  if ((along ? 1 : -1) * dot(s.normal, base.normal) < same_direction) {
    fail(along ? "does not face the same way as its" : "does not face its");
  }
  if (!encloses(base.outline, base.normal, s.outline, slack)) fail("does not lie within its");
  on_[s.base - 1].push_back(i);
  if (on_[s.base - 1].size() > most_on_one_base) {
    throw input_error(path_, s.line, fmt::format("more than {} surfaces on base surface {}", most_on_one_base, s.base));
  }
}

/// What of a surface is not covered by those whose base it is.
std::vector<Outline> Builder::pieces(std::size_t i) const {
  const vs3::Surface& s = surfaces_[i];
  std::vector<Outline> left{s.outline}, next;
  for (const std::size_t k : on_[i]) {
    Outline hole = surfaces_[k].outline;
    if (surfaces_[k].kind != Kind::radiating) hole = Outline(hole.rbegin(), hole.rend());
    next.clear();
    for (const Outline& piece : left) subtract(piece, hole, s.normal, 1e-9 * s.radius, next);
    std::swap(left, next);
  }
  return left;
}

std::uint32_t Builder::material(const Look& look) {
  const auto [entry, added] = materials_.try_emplace(look, static_cast<std::uint32_t>(scene_.materials.size()));
  if (!added) return entry->second;
  Material m;
  if (look.kind == Look::Kind::radiating) {
    m.name = fmt::format("emittance {:g}", look.emittance);
    m.reflectance.fill(1 - look.emittance);
    m.emittance.fill(look.emittance);
  } else {
    m.name = "obstruction";
    m.two_sided = look.kind == Look::Kind::obstruction;  // what ends on its back must not be missing from the row sums
  }
  scene_.materials.push_back(std::move(m));
  return entry->second;
}

void Builder::add(std::size_t i) {
  const vs3::Surface& s = surfaces_[i];
  const bool blocks = s.kind == Kind::obstruction;
  std::vector<Outline> left = pieces(i);
  if (left.empty()) warn(fmt::format("{}:{}: nothing of surface {} is left uncovered", path_, s.line, i + 1));
  const auto surface = [&](const std::string& group, const Look& look) {
    scene_.surfaces.push_back({names_[i], group, material(look), look.kind != Look::Kind::radiating});
    add_pieces(left, s.line);
  };
  if (blocks) return surface("obstruction", {Look::Kind::obstruction, 0});
  surface(names_[s.combine > 0 ? s.combine - 1 : i], {Look::Kind::radiating, s.emittance});
  std::size_t root = i;
  while (surfaces_[root].base > 0) root = surfaces_[root].base - 1;
  if (surfaces_[root].kind != Kind::obstruction) return;
  // Behind a surface on an obstruction there is the obstruction.
  for (Outline& piece : left) std::reverse(piece.begin() + 1, piece.end());
  surface("obstruction", {Look::Kind::back, 0});
}

void Builder::add_pieces(const std::vector<Outline>& pieces, std::uint32_t line) {
  const auto index = static_cast<std::uint32_t>(scene_.surfaces.size() - 1);
  for (const Outline& piece : pieces) {
    const auto first = static_cast<std::uint32_t>(scene_.positions.size());
    scene_.positions.insert(scene_.positions.end(), piece.begin(), piece.end());
    for (std::uint32_t k = 1; k + 1 < piece.size(); ++k) {
      scene_.triangles.push_back({{first, first + k, first + k + 1}, index, line, -1});
    }
    if (scene_.triangles.size() > max_scene_triangles) {
      throw input_error(path_, line, fmt::format("more than {} triangles", max_scene_triangles));
    }
  }
}

}  // namespace

Scene read_vs3(const std::string& text, const std::filesystem::path& path) {
  Scene scene = Builder(vs3::read_records(text, path.string()), path.string()).run();
  scene.name = path.stem().string();
  scene.file = path.string();
  return scene;
}

}  // namespace interflect
