#include "interflect/scene/vs3_records.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/scene/convex.h"
#include "interflect/scene/obj_material.h"
#include "interflect/scene/scene_limits.h"
#include "interflect/scene/text.h"
#include "interflect/scene/vs3_control.h"
#include "interflect/scene/vs3_words.h"

namespace interflect::vs3 {

namespace {

using Kind = Surface::Kind;

class Reader {
 public:
  Reader(std::string_view text, const std::string& file) : in_(text, file), control_(file) {}

  File run() {
    while (in_.next_record() && !end_) record();
    if (std::none_of(out_.surfaces.begin(), out_.surfaces.end(),
                     [](const Surface& s) { return s.kind == Kind::radiating; })) {
      throw input_error(in_.file(), 0, "holds no radiating surface (S)");
    }
    check_numbers();
    control_.report(out_.warnings);
    for (const auto& [letter, count] : ignored_) {
      warn(fmt::format("{}: '{}' records are ignored: {}", in_.file(), one_line(std::string_view(&letter, 1)), count));
    }
    return std::move(out_);
  }

 private:
  void record();
  void format();
  void vertex();
  void surface(Kind kind);
  void numbers(Surface& s);
  void corners_of_vertices(Surface& s);
  void corners_of_shape(Surface& s, char shape);
  Vec3 point(std::string_view what);
  void measure(Surface& s);
  void check_numbers() const;
  void warn(std::string text) { add_warning(out_.warnings, std::move(text)); }

  Words in_;
  Control control_;
  File out_;
  bool blast_ = false;  ///< format 3a: shapes in a plane each instead of vertices
  bool format_known_ = false, end_ = false;
  std::vector<Vec3> vertices_;
  std::map<char, std::uint64_t> ignored_;
};

void Reader::record() {
  switch (in_.letter()) {
    case '/':
    case 'T': return;
    case 'C': return control_.read(in_);
    case 'F': return format();
    case 'S': return surface(Kind::radiating);
    case 'M': return surface(Kind::mask);
    case 'N': return surface(Kind::null);
    case 'O': return surface(Kind::obstruction);
    case 'E':
    case '*': end_ = true; return;
    case 'V':
      if (!blast_) return vertex();
      [[fallthrough]];
    default: ++ignored_[in_.letter()];
  }
}

void Reader::format() {
  const std::string_view name = in_.word();
  if (name == "2") in_.fail("F 2 is View3D's two-dimensional geometry: only three dimensions (3 and 3a) are read");
  if (name != "3" && name != "3a" && name != "3A") {
    in_.fail(fmt::format("'{}' is not a geometry format: 3 and 3a are", one_line(name)));
  }
  const bool blast = name != "3";
  if ((format_known_ && blast != blast_) || !vertices_.empty() || !out_.surfaces.empty()) {
    in_.fail("one F record, before the vertices and surfaces, says how they are given");
  }
  blast_ = blast;
  format_known_ = true;
}

Vec3 Reader::point(std::string_view what) {
  const double x = in_.number(what), y = in_.number(what), z = in_.number(what);
  if (!(std::max({std::abs(x), std::abs(y), std::abs(z)}) <= max_scene_coordinate)) {
    in_.fail(fmt::format("a {} lies further out than {:g}", what, max_scene_coordinate));
  }
  return {x, y, z};
}

void Reader::vertex() {
  const std::int64_t number = in_.integer("vertex number");
  if (number != static_cast<std::int64_t>(vertices_.size()) + 1) {
    in_.fail(fmt::format("vertex {} is out of sequence: the next one is {}", number, vertices_.size() + 1));
  }
  vertices_.push_back(point("coordinate"));
}

void Reader::surface(Kind kind) {
  const std::size_t next = out_.surfaces.size() + 1;
  const std::int64_t number = in_.integer("surface number");
  if (number != static_cast<std::int64_t>(next)) {
    in_.fail(fmt::format("surface {} is out of sequence: the next one is {}", number, next));
  }
  if (next > max_scene_surfaces) in_.fail(fmt::format("more than {} surfaces", max_scene_surfaces));
  if (kind != Kind::obstruction && next > 1 && out_.surfaces.back().kind == Kind::obstruction) {
    in_.fail("the obstructions (O) come after all other surfaces");
  }
  Surface s;
  s.kind = kind;
  s.line = in_.line();
  if (blast_) {
    const std::string_view shape = in_.word();
    const char letter = shape.empty() ? ' ' : static_cast<char>(std::toupper(static_cast<unsigned char>(shape[0])));
    if (letter != 'R' && letter != 'T' && letter != 'Q') {
      in_.fail(
          fmt::format("'{}' is not a shape: R (rectangle), Q (quadrilateral) and T (triangle) are", one_line(shape)));
    }
    numbers(s);
    in_.skip_line();
    corners_of_shape(s, letter);
  } else {
    corners_of_vertices(s);
    numbers(s);
  }
  measure(s);
  out_.surfaces.push_back(std::move(s));
}

void Reader::corners_of_vertices(Surface& s) {
  constexpr std::array<std::string_view, 4> what{"first vertex", "second vertex", "third vertex", "fourth vertex"};
  for (std::size_t k = 0; k < 4; ++k) {
    const std::int64_t v = in_.integer(what[k]);
    if (v == 0 && k == 3) return;
    if (v < 1 || v > static_cast<std::int64_t>(vertices_.size())) {
      in_.fail(fmt::format("{}: there is no vertex {} among the {} so far", what[k], v, vertices_.size()));
    }
    s.outline.push_back(vertices_[static_cast<std::size_t>(v - 1)]);
  }
}

/// An origin, the azimuth in which the shape's plane faces (clockwise from +y) and its tilt (0: facing up); then the
/// shape in that plane, x to the right and y upward as seen from the front.
void Reader::corners_of_shape(Surface& s, char shape) {
  const Vec3 origin = point("origin");
  const double azimuth = in_.number("azimuth") * std::numbers::pi / 180;
  const double tilt = in_.number("tilt") * std::numbers::pi / 180;
  const Vec3 right{-std::cos(azimuth), std::sin(azimuth), 0};
  const Vec3 up{-std::cos(tilt) * std::sin(azimuth), -std::cos(tilt) * std::cos(azimuth), std::sin(tilt)};
  std::vector<Vec2> flat;
  if (shape == 'R') {
    const double width = in_.number("width"), height = in_.number("height");
    if (!(width > 0 && height > 0)) in_.fail("a rectangle's width and height are above 0");
    flat = {{0, height}, {0, 0}, {width, 0}, {width, height}};
  } else {
    for (int k = 0; k < (shape == 'T' ? 3 : 4); ++k) {
      const double x = in_.number("x"), y = in_.number("y");
      flat.push_back({x, y});
    }
  }
  for (const Vec2 p : flat) {
    const Vec3 v = origin + p.x * right + p.y * up;
    if (!(std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}) <= max_scene_coordinate)) {
      in_.fail(fmt::format("a corner lies further out than {:g}", max_scene_coordinate));
    }
    s.outline.push_back(v);
  }
}

/// Base, combination, emittance, name. An obstruction has none of them; what its line holds is skipped.
void Reader::numbers(Surface& s) {
  if (s.kind == Kind::obstruction) return;
  constexpr auto most = static_cast<std::int64_t>(max_scene_surfaces);
  const std::int64_t base = in_.integer("base surface");
  if (base < 0 || base > most) in_.fail(fmt::format("there is no base surface {}", base));
  s.base = static_cast<std::uint32_t>(base);
  const std::int64_t combine = in_.integer("surface to combine with");
  if (combine < 0 || combine > most) in_.fail(fmt::format("there is no surface {} to combine with", combine));
  s.combine = static_cast<std::uint32_t>(combine);
  s.emittance = in_.number("emittance");
  if (!(s.emittance >= 0 && s.emittance <= 1)) {
    in_.fail(fmt::format("an emittance lies between 0 and 1, not at {:g}", s.emittance));
  }
  s.name = in_.word().substr(0, max_scene_name);
}

void Reader::measure(Surface& s) {
  // A quadrilateral with two corners in one place is a triangle.
  for (std::size_t k = 0; k < s.outline.size() && s.outline.size() > 3; ++k) {
    if (s.outline[k] == s.outline[(k + 1) % s.outline.size()]) {
      s.outline.erase(s.outline.begin() + static_cast<std::ptrdiff_t>(k));
    }
  }
  s.middle = middle(s.outline);
  s.normal = normalized(area_vector(s.outline));
  for (const Vec3 p : s.outline) s.radius = std::max(s.radius, length(p - s.middle));
  if (s.outline.size() < 4) return;
  // A bow tie's halves may cancel: then one of its corners says which way is right.
  const Vec3 front =
      s.normal == Vec3{} ? normalized(cross(s.outline[1] - s.outline[0], s.outline[2] - s.outline[1])) : s.normal;
  if (!is_convex(s.outline, front)) {
    in_.fail(fmt::format("surface {} is not convex: two triangles or convex parts, combined, are",
                         out_.surfaces.size() + 1));
  }
  constexpr double flat = 3e-6;  // where View3D begins to warn
  const double off = distance_from_plane(s.outline, s.middle, s.normal);
  if (off > flat * s.radius) {
    warn(fmt::format("{}:{}: the corners of surface {} lie up to {:.2g} off a plane: taken as two triangles",
                     in_.file(), s.line, out_.surfaces.size() + 1, off));
  }
}

void Reader::check_numbers() const {
  const auto count = static_cast<std::uint32_t>(out_.surfaces.size());
  for (std::uint32_t number = 1; number <= count; ++number) {
    const Surface& s = out_.surfaces[number - 1];
    const auto fail = [&](const std::string& cause) { throw input_error(in_.file(), s.line, cause); };
    if ((s.kind == Kind::mask || s.kind == Kind::null) && s.base == 0) fail("a mask or null surface needs a base");
    if (s.base > count) fail(fmt::format("there is no base surface {}: the last one is {}", s.base, count));
    if (s.base > 0) {
      const Kind kind = out_.surfaces[s.base - 1].kind;
      if (kind == Kind::mask || kind == Kind::null)
        fail(fmt::format("base surface {} is a mask or null surface", s.base));
      if (kind == Kind::obstruction && s.kind != Kind::radiating) {
        fail(fmt::format("base surface {} is an obstruction, which a mask or null surface cannot have", s.base));
      }
      if (kind == Kind::radiating && s.base >= number) {
        fail(fmt::format("surface {} must come after its base surface {}", number, s.base));
      }
    }
    if (s.combine == 0) continue;
    if (s.kind != Kind::radiating) fail("a mask or null surface cannot be combined with another one");
    if (s.combine >= number)
      fail(fmt::format("surface {} must come after {}, which it is combined with", number, s.combine));
    const Surface& other = out_.surfaces[s.combine - 1];
    if (other.kind != Kind::radiating)
      fail(fmt::format("surface {} to combine with is a mask or null surface", s.combine));
    if (other.combine != 0) {
      fail(fmt::format("surface {} to combine with is itself combined with {}: name that one", s.combine,
                       other.combine));
    }
  }
}

}  // namespace

File read_records(std::string_view text, const std::string& file) {
  return Reader(text, file).run();
}

}  // namespace interflect::vs3
