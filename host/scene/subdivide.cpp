#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/scene/geometry.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/texture.h"

namespace interflect {

namespace {

constexpr std::uint64_t saturated = std::numeric_limits<std::uint64_t>::max();

/// Relative slack of the comparison with the wanted area: children of equal triangles must fall on the same side of it.
constexpr double slack = 1e-9;

/// How often a triangle is split: the smallest depth with area / 4^depth <= divide. 31 and more count as too many.
unsigned depth_of(double area, double divide) {
  if (divide <= 0) return 0;
  unsigned depth = 0;
  for (const double largest = divide * (1 + slack); area > largest && depth < 31; area /= 4) ++depth;
  return depth;
}

/// What counting needs of a triangle.
struct Countable {
  double area;
  unsigned sides;
};

std::vector<Countable> countable(const Scene& scene, bool two_sided) {
  require_sound(scene);
  std::vector<Countable> out;
  out.reserve(scene.triangles.size());
  for (const Triangle& t : scene.triangles) {
    if (!degenerate(scene, t)) out.push_back({scene.area(t), has_two_sides(scene, t, two_sided) ? 2u : 1u});
  }
  return out;
}

std::uint64_t count(const std::vector<Countable>& triangles, double divide) {
  std::uint64_t sum = 0;
  for (const Countable& t : triangles) {
    const unsigned depth = depth_of(t.area, divide);
    const std::uint64_t more = depth >= 31 ? saturated : std::uint64_t{t.sides} << (2 * depth);
    if (more > saturated - sum) return saturated;
    sum += more;
  }
  return sum;
}

void require_area(double divide) {
  if (!std::isfinite(divide) || divide < 0) {
    throw Error(ErrorKind::usage, fmt::format("the patch area must be a finite number >= 0, not {}", divide));
  }
}

/// The step of the count at `target`: counts are > target for areas up to `below`, and <= target from `above` on, the
/// next double. The count falls as the area grows, so bisection finds it; the bits of positive doubles are in order.
struct Step {
  double below, above;
};

double largest_area(const std::vector<Countable>& triangles) {
  double largest = 0;
  for (const Countable& t : triangles) largest = std::max(largest, t.area);
  return largest;
}

Step step_at(const std::vector<Countable>& triangles, std::uint64_t target) {
  std::uint64_t below = std::bit_cast<std::uint64_t>(std::numeric_limits<double>::denorm_min());
  std::uint64_t above = std::bit_cast<std::uint64_t>(largest_area(triangles));
  while (above > below + 1) {
    const std::uint64_t middle = below + (above - below) / 2;
    (count(triangles, std::bit_cast<double>(middle)) > target ? below : above) = middle;
  }
  return {std::bit_cast<double>(below), std::bit_cast<double>(above)};
}

/// An area with few digits whose count is `wanted`, between the ends of that step.
double plain_area(const std::vector<Countable>& triangles, std::uint64_t wanted) {
  if (wanted == count(triangles, 0)) return largest_area(triangles);
  const Step lower_end = step_at(triangles, wanted);
  const Step upper_end = step_at(triangles, wanted - 1);
  const double middle = std::sqrt(lower_end.above) * std::sqrt(upper_end.below);
  for (const int digits : {2, 3, 4, 6, 9, 12}) {
    const double rounded = std::stod(fmt::format("{:.{}g}", middle, digits));
    if (count(triangles, rounded) == wanted) return rounded;
  }
  return count(triangles, middle) == wanted ? middle : lower_end.above;
}

double choose(const std::vector<Countable>& triangles, std::uint64_t patches) {
  const std::uint64_t coarsest = count(triangles, 0);
  if (patches <= coarsest) return plain_area(triangles, coarsest);
  const Step step = step_at(triangles, patches);
  const std::uint64_t more = count(triangles, step.below), fewer = count(triangles, step.above);
  return plain_area(triangles, more > patches && more - patches < patches - fewer ? more : fewer);
}

void require_within(const std::vector<Countable>& triangles, double divide, std::uint64_t most) {
  const std::uint64_t wanted = count(triangles, divide);
  if (wanted <= most) return;
  const std::string many = wanted == saturated ? "more than 10^19" : fmt::format("{}", wanted);
  const std::uint64_t coarsest = count(triangles, 0);
  if (coarsest > most) {
    throw Error(ErrorKind::limit,
                fmt::format("the scene has {} patches before any division, more than the limit of {}", coarsest, most));
  }
  const double fits = plain_area(triangles, count(triangles, step_at(triangles, most).above));
  throw Error(ErrorKind::limit, fmt::format("a patch area of {:g} gives {} patches, more than the limit of {}: use "
                                            "--divide {} or larger",
                                            divide, many, most, fits));
}

/// Makes the patches of one source triangle after the other.
class Cutter {
 public:
  Cutter(const Scene& scene, double divide, double tolerance) : scene_(scene), divide_(divide), welder_(tolerance) {}

  void cut(std::uint32_t source, bool two_sided);
  [[nodiscard]] PatchMesh finish() {
    mesh_.vertices = welder_.take();
    mesh_.surfaces = scene_.surfaces;
    return std::move(mesh_);
  }

 private:
  struct Piece {
    std::array<std::uint32_t, 3> corners;
    std::array<Vec2, 3> uv;
  };
  void split(const Piece& piece, unsigned depth);
  void add(const Piece& piece);
  void add_back_sides(std::size_t first);
  [[nodiscard]] Rgb colour(const Rgb& constant, int image, const std::array<Vec2, 3>& uv) const;

  const Scene& scene_;
  double divide_;
  VertexWelder welder_;
  PatchMesh mesh_;
  // Of the source triangle at work:
  std::uint32_t source_ = 0;
  const Material* material_ = nullptr;
  Vec3 normal_{};
  double tolerance_ = 0;
};

void Cutter::cut(std::uint32_t source, bool two_sided) {
  const Triangle& t = scene_.triangles[source];
  const std::array<Vec3, 3> p{scene_.positions[t.vertex[0]], scene_.positions[t.vertex[1]],
                              scene_.positions[t.vertex[2]]};
  const unsigned depth = depth_of(scene_.area(t), divide_);
  source_ = source;
  material_ = &scene_.materials[scene_.surfaces[t.surface].material];
  normal_ = normalized(cross(p[1] - p[0], p[2] - p[0]));
  tolerance_ = weld_share_of_altitude * std::ldexp(smallest_altitude(p[0], p[1], p[2]), -static_cast<int>(depth));
  Piece whole{};
  for (std::size_t k = 0; k < 3; ++k) {
    whole.corners[k] = welder_.index_of(p[k], tolerance_);
    if (t.uv >= 0) whole.uv[k] = scene_.uvs[static_cast<std::size_t>(t.uv) + k];
  }
  const std::size_t first = mesh_.size();
  split(whole, depth);
  if (two_sided) add_back_sides(first);
}

void Cutter::split(const Piece& piece, unsigned depth) {
  if (depth == 0) return add(piece);
  std::array<std::uint32_t, 3> middle{};  // of the edge from corner k to k + 1
  std::array<Vec2, 3> uv{};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    const Vec3 a = welder_.points()[piece.corners[k]], b = welder_.points()[piece.corners[next]];
    middle[k] = welder_.index_of(0.5 * (a + b), tolerance_);
    uv[k] = (piece.uv[k] + piece.uv[next]) * 0.5;
  }
  // The centre second: it touches the first and the third, and the third touches the fourth.
  split({{piece.corners[0], middle[0], middle[2]}, {piece.uv[0], uv[0], uv[2]}}, depth - 1);
  split({{middle[1], middle[2], middle[0]}, {uv[1], uv[2], uv[0]}}, depth - 1);
  split({{middle[0], piece.corners[1], middle[1]}, {uv[0], piece.uv[1], uv[1]}}, depth - 1);
  split({{middle[2], middle[1], piece.corners[2]}, {uv[2], uv[1], piece.uv[2]}}, depth - 1);
}

Rgb Cutter::colour(const Rgb& constant, int image, const std::array<Vec2, 3>& uv) const {
  if (image < 0 || static_cast<std::size_t>(image) >= scene_.images.size()) return constant;
  if (scene_.triangles[source_].uv < 0) return constant;
  Rgb out = mean_over(scene_.images[static_cast<std::size_t>(image)], uv);
  for (std::size_t c = 0; c < 3; ++c) out[c] *= constant[c];
  return out;
}

void Cutter::add(const Piece& piece) {
  const Vec3 a = welder_.points()[piece.corners[0]], b = welder_.points()[piece.corners[1]],
             c = welder_.points()[piece.corners[2]];
  mesh_.corners.push_back(piece.corners);
  mesh_.area.push_back(0.5 * length(cross(b - a, c - a)));
  mesh_.centroid.push_back((a + b + c) / 3);
  mesh_.normal.push_back(normal_);
  mesh_.reflectance.push_back(colour(material_->reflectance, material_->reflectance_image, piece.uv));
  mesh_.emittance.push_back(colour(material_->emittance, material_->emittance_image, piece.uv));
  mesh_.surface.push_back(scene_.triangles[source_].surface);
  mesh_.source.push_back(source_);
}

void Cutter::add_back_sides(std::size_t first) {
  const std::size_t last = mesh_.size();
  const auto repeat = [](auto& list, std::size_t i) {
    const auto value = list[i];
    list.push_back(value);
  };
  for (std::size_t i = first; i < last; ++i) {
    const auto corners = mesh_.corners[i];
    mesh_.corners.push_back({corners[0], corners[2], corners[1]});
    mesh_.normal.push_back(-normal_);
    repeat(mesh_.area, i);
    repeat(mesh_.centroid, i);
    repeat(mesh_.reflectance, i);
    repeat(mesh_.emittance, i);
    repeat(mesh_.surface, i);
    repeat(mesh_.source, i);
  }
}

}  // namespace

std::uint64_t count_patches(const Scene& scene, double divide, bool two_sided) {
  require_area(divide);
  return count(countable(scene, two_sided), divide);
}

double choose_divide(const Scene& scene, std::uint64_t patches, bool two_sided) {
  const std::vector<Countable> triangles = countable(scene, two_sided);
  if (triangles.empty()) throw input_error(scene.file, 0, "holds no triangle with an area");
  return choose(triangles, patches);
}

PatchMesh subdivide(const Scene& scene, const SubdivideOptions& options) {
  require_area(options.divide);
  const std::vector<Countable> triangles = countable(scene, options.two_sided);
  if (triangles.empty()) throw input_error(scene.file, 0, "holds no triangle with an area");
  const double divide = options.patches > 0 ? choose(triangles, options.patches) : options.divide;
  // Corner indices have 32 bits; three new ones per patch is the worst case.
  require_within(triangles, divide, std::min(options.max_patches, std::uint64_t{1} << 30));

  std::vector<double> altitudes;
  for (const Triangle& t : scene.triangles) {
    if (degenerate(scene, t)) continue;
    const double whole =
        smallest_altitude(scene.positions[t.vertex[0]], scene.positions[t.vertex[1]], scene.positions[t.vertex[2]]);
    altitudes.push_back(std::ldexp(whole, -static_cast<int>(depth_of(scene.area(t), divide))));
  }
  Cutter cutter(scene, divide, weld_tolerance(diagonal(scene), std::move(altitudes)));
  for (std::uint32_t i = 0; i < scene.triangles.size(); ++i) {
    const Triangle& t = scene.triangles[i];
    if (!degenerate(scene, t)) cutter.cut(i, has_two_sides(scene, t, options.two_sided));
  }
  return cutter.finish();
}

}  // namespace interflect
