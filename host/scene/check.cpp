#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <tuple>

#include "interflect/base/error.h"
#include "interflect/scene/geometry.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/text.h"

namespace interflect {

namespace {

using Severity = Finding::Severity;

/// Collects the offenders of one kind.
class Offenders {
 public:
  Offenders(Severity severity, std::string what) { finding_ = {severity, std::move(what), 0, {}}; }
  template <typename Name>
  void add(const Name& name) {
    constexpr std::size_t most_named = 3;
    ++finding_.count;
    if (finding_.first.size() == most_named) return;
    std::string text = name();
    if (finding_.first.empty() || finding_.first.back() != text) finding_.first.push_back(std::move(text));
  }
  void report(std::vector<Finding>& out) && {
    if (finding_.count > 0) out.push_back(std::move(finding_));
  }

 private:
  Finding finding_;
};

void check_materials(const Scene& scene, std::vector<Finding>& out) {
  constexpr std::size_t unused = SIZE_MAX;
  std::vector<std::size_t> user(scene.materials.size(), unused);  // the first triangle of each material
  bool emits = false;
  for (std::size_t i = 0; i < scene.triangles.size(); ++i) {
    const std::uint32_t material = scene.surfaces[scene.triangles[i].surface].material;
    if (user[material] == unused) user[material] = i;
    const Rgb& e = scene.materials[material].emittance;
    if ((e[0] > 0 || e[1] > 0 || e[2] > 0) && !degenerate(scene, scene.triangles[i])) emits = true;
  }
  Offenders reflectance(Severity::error, "materials with a reflectance outside [0, 1]");
  Offenders emittance(Severity::error, "materials with a negative, huge (above 1e30) or non-finite emittance");
  for (std::size_t m = 0; m < scene.materials.size(); ++m) {
    if (user[m] == unused) continue;
    const Material& material = scene.materials[m];
    const auto name = [&](const Rgb& value) {
      return fmt::format("'{}' ({:g} {:g} {:g}), used at {}", one_line(material.name), value[0], value[1], value[2],
                         place_of(scene, user[m]));
    };
    // Written so that a NaN offends.
    const auto physical = [](double v, double most) { return v >= 0 && v <= most; };
    const Rgb &r = material.reflectance, &e = material.emittance;
    if (!(physical(r[0], 1) && physical(r[1], 1) && physical(r[2], 1))) reflectance.add([&] { return name(r); });
    constexpr double most = 1e30;  // radiosities, and sums of them, are to stay finite in single precision
    if (!(physical(e[0], most) && physical(e[1], most) && physical(e[2], most))) emittance.add([&] { return name(e); });
  }
  std::move(reflectance).report(out);
  std::move(emittance).report(out);
  if (!emits) out.push_back({Severity::warning, "no surface emits light: every radiosity will be 0", 1, {}});
}

using Corners = std::array<std::uint32_t, 3>;

/// A triangle with its welded corners.
struct Face {
  std::uint32_t triangle;
  Corners corners;
};

/// The triangles that have an area, welded as for patches; the others are reported.
std::vector<Face> faces_of(const Scene& scene, std::vector<Finding>& out) {
  Offenders dropped(Severity::warning, "degenerate triangles (dropped)");
  std::vector<double> altitudes(scene.triangles.size());
  std::vector<double> kept;
  for (std::size_t i = 0; i < scene.triangles.size(); ++i) {
    const Triangle& t = scene.triangles[i];
    if (degenerate(scene, t)) {
      dropped.add([&] { return place_of(scene, i); });
      continue;
    }
    const auto& p = scene.positions;
    altitudes[i] = smallest_altitude(p[t.vertex[0]], p[t.vertex[1]], p[t.vertex[2]]);
    kept.push_back(altitudes[i]);
  }
  std::move(dropped).report(out);

  VertexWelder welder(weld_tolerance(diagonal(scene), std::move(kept)));
  std::vector<Face> faces;
  for (std::uint32_t i = 0; i < scene.triangles.size(); ++i) {
    if (!(altitudes[i] > 0)) continue;
    Face face{i, {}};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 p = scene.positions[scene.triangles[i].vertex[k]];
      face.corners[k] = welder.index_of(p, weld_share_of_altitude * altitudes[i]);
    }
    faces.push_back(face);
  }
  return faces;
}

/// Reports and removes faces that repeat an earlier one with the same winding.
void check_duplicates(const Scene& scene, std::vector<Face>& faces, std::vector<Finding>& out) {
  const auto canonical = [](Corners c) {
    std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
    return c;
  };
  std::vector<std::pair<Corners, std::uint32_t>> sorted;  // rotated corners, index into faces
  for (std::uint32_t i = 0; i < faces.size(); ++i) sorted.emplace_back(canonical(faces[i].corners), i);
  std::sort(sorted.begin(), sorted.end());
  std::vector<std::pair<std::uint32_t, std::uint32_t>> repeats;  // the later face, the first one
  std::size_t first = 0;
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    if (sorted[i].first != sorted[first].first) {
      first = i;
    } else {
      repeats.emplace_back(sorted[i].second, sorted[first].second);
    }
  }
  std::sort(repeats.begin(), repeats.end());
  Offenders offenders(Severity::warning, "duplicate triangles");
  for (const auto& [later, original] : repeats) {
    offenders.add([&, later = later, original = original] {  // Clang 14 captures no structured bindings
      return fmt::format("{} repeats {}", place_of(scene, faces[later].triangle),
                         place_of(scene, faces[original].triangle));
    });
  }
  std::move(offenders).report(out);
  for (auto it = repeats.rbegin(); it != repeats.rend(); ++it) {
    faces[it->first].corners = {};  // marked, so that one pass can remove them all
  }
  std::erase_if(faces, [](const Face& f) { return f.corners == Corners{}; });
}

/// One face's use of an edge.
struct Use {
  std::uint32_t low, high;  ///< the edge's ends
  std::uint32_t face;
  bool rising;  ///< the face runs through it from low to high
  [[nodiscard]] bool same_edge(const Use& other) const { return low == other.low && high == other.high; }
};

std::vector<Use> edge_uses(const std::vector<Face>& faces) {
  std::vector<Use> uses;
  uses.reserve(3 * faces.size());
  for (std::uint32_t f = 0; f < faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = faces[f].corners[k], b = faces[f].corners[(k + 1) % 3];
      uses.push_back({std::min(a, b), std::max(a, b), f, a < b});
    }
  }
  std::sort(uses.begin(), uses.end(), [](const Use& a, const Use& b) {
    return std::tie(a.low, a.high, a.face) < std::tie(b.low, b.high, b.face);
  });
  return uses;
}

/// The faces of one connected piece of surface: reached over edges that exactly two faces use.
class Pieces {
 public:
  explicit Pieces(std::size_t faces) : links_(faces), open_(faces) {}
  void link(const Use& a, const Use& b) {
    const bool against = a.rising == b.rising;  // neighbours that agree run through their edge in opposite directions
    links_[a.face].push_back({b.face, against});
    links_[b.face].push_back({a.face, against});
  }
  void mark_open(std::uint32_t face) { open_[face] = true; }

  /// The faces of closed pieces whose winding disagrees with the greater part of their piece.
  [[nodiscard]] std::vector<std::uint32_t> disagreeing() const {
    std::vector<std::uint32_t> out;
    std::vector<signed char> side(links_.size(), -1);  // -1: not reached yet
    for (std::uint32_t start = 0; start < links_.size(); ++start) {
      if (side[start] >= 0) continue;
      std::vector<std::uint32_t> piece{start};
      side[start] = 0;
      bool closed = true;
      std::size_t turned = 0;
      for (std::size_t i = 0; i < piece.size(); ++i) {
        closed = closed && !open_[piece[i]];
        turned += side[piece[i]] == 1 ? 1u : 0u;
        for (const Link& link : links_[piece[i]]) {
          if (side[link.face] >= 0) continue;
          side[link.face] = link.against ? static_cast<signed char>(1 - side[piece[i]]) : side[piece[i]];
          piece.push_back(link.face);
        }
      }
      if (!closed || turned == 0) continue;
      const signed char minority = turned <= piece.size() / 2 ? 1 : 0;
      std::copy_if(piece.begin(), piece.end(), std::back_inserter(out), [&](auto f) { return side[f] == minority; });
    }
    std::sort(out.begin(), out.end());
    return out;
  }

 private:
  struct Link {
    std::uint32_t face;
    bool against;
  };
  std::vector<std::vector<Link>> links_;
  std::vector<bool> open_;
};

void check_edges(const Scene& scene, const std::vector<Face>& faces, bool two_sided, std::vector<Finding>& out) {
  Offenders open(Severity::warning, "open edges (the scene is not closed there, or a corner lies on a longer edge)");
  Pieces pieces(faces.size());
  const std::vector<Use> uses = edge_uses(faces);
  for (std::size_t i = 0; i < uses.size();) {
    std::size_t end = i + 1;
    while (end < uses.size() && uses[end].same_edge(uses[i])) ++end;
    if (end - i == 1) {
      pieces.mark_open(uses[i].face);
      open.add([&] { return place_of(scene, faces[uses[i].face].triangle); });
    } else if (end - i == 2) {
      pieces.link(uses[i], uses[i + 1]);
    }
    i = end;
  }
  Offenders against(Severity::warning, "triangles whose normal disagrees with the closed surface around them");
  for (const std::uint32_t face : pieces.disagreeing()) {
    const std::uint32_t t = faces[face].triangle;
    if (!has_two_sides(scene, scene.triangles[t], two_sided)) against.add([&] { return place_of(scene, t); });
  }
  std::move(against).report(out);
  std::move(open).report(out);
}

}  // namespace

std::string Finding::line() const {
  if (first.empty()) return what;
  return fmt::format("{}: {}, first: {}", what, count, fmt::join(first, "; "));
}

std::vector<Finding> check_scene(const Scene& scene, bool two_sided) {
  std::vector<Finding> out;
  try {
    require_sound(scene);
  } catch (const Error& error) {
    out.push_back({Severity::error, error.what(), 1, {}});
    return out;
  }
  check_materials(scene, out);
  std::vector<Face> faces = faces_of(scene, out);
  check_duplicates(scene, faces, out);
  check_edges(scene, faces, two_sided, out);
  return out;
}

}  // namespace interflect
