#include "interflect/output/page_data.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "interflect/base/error.h"
#include "interflect/base/half.h"
#include "interflect/output/bytes.h"
#include "interflect/output/smooth.h"

namespace interflect {

namespace {

using Json = nlohmann::ordered_json;

/// The description and the numbers as they grow together.
class Sections {
 public:
  template <class T>
  void add(const std::string& name, const std::vector<T>& values) {
    numbers_.append((4 - numbers_.size() % 4) % 4, '\0');
    const char* type = sizeof(T) == 2 ? "f16" : std::is_floating_point_v<T> ? "f32" : "u32";
    list_[name] = {{"type", type}, {"at", numbers_.size()}, {"count", values.size()}};
    for (const T v : values) append_little_endian(numbers_, v);
  }
  void add(const std::string& name, const std::vector<Rgb>& values) { add(name, floats(values)); }

  [[nodiscard]] Json& list() { return list_; }
  [[nodiscard]] std::string& numbers() { return numbers_; }

 private:
  static std::vector<float> floats(const std::vector<Rgb>& values) {
    std::vector<float> out;
    out.reserve(3 * values.size());
    for (const Rgb& v : values) {
      for (const double c : v) out.push_back(std::isfinite(c) ? finite_float(c) : std::nanf(""));
    }
    return out;
  }

  Json list_ = Json::object();
  std::string numbers_;
};

/// The middle of what the patches span; positions are given from there, so that single precision suffices anywhere.
Vec3 middle(const PatchMesh& mesh) {
  Vec3 low = mesh.vertices.front(), high = low;
  for (const Vec3 v : mesh.vertices) {
    low = {std::min(low.x, v.x), std::min(low.y, v.y), std::min(low.z, v.z)};
    high = {std::max(high.x, v.x), std::max(high.y, v.y), std::max(high.z, v.z)};
  }
  return (low + high) * 0.5;
}

void add_mesh(Sections& sections, const PatchMesh& mesh, Vec3 origin) {
  std::vector<float> positions, area;
  for (const Vec3 v : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) positions.push_back(finite_float(v[axis] - origin[axis]));
  }
  for (const double a : mesh.area) area.push_back(finite_float(a));
  const SmoothMesh smooth = smooth_mesh(mesh);
  std::vector<std::uint32_t> corners, smooth_corners, hanging;
  for (const auto& c : mesh.corners) corners.insert(corners.end(), c.begin(), c.end());
  for (const auto& c : smooth.corners) smooth_corners.insert(smooth_corners.end(), c.begin(), c.end());
  for (const auto& h : smooth.hanging) hanging.insert(hanging.end(), {h.vertex, h.ends[0], h.ends[1]});
  sections.add("positions", positions);
  sections.add("corners", corners);
  sections.add("smooth_corners", smooth_corners);
  sections.add("hanging", hanging);
  sections.add("area", area);
  sections.add("surface", mesh.surface);
}

void add_values(Sections& sections, const Solution& solution) {
  const PatchMesh& mesh = *solution.mesh;
  sections.add("reflectance", mesh.reflectance);
  sections.add("emittance", mesh.emittance);
  std::vector<float> sums;
  for (const double s : solution.row_sum) sums.push_back(finite_float(s));
  sections.add("row_sum", sums);
  if (solution.lights.names.empty()) {
    sections.add("lit.0", solution.radiosity);
    return;
  }
  sections.add("lamp", solution.lights.of_patch);
  for (std::size_t g = 0; g < solution.lit.size(); ++g) sections.add(fmt::format("lit.{}", g), solution.lit[g]);
}

/// The largest finite radiosity of a bounce series; 1 when all are black.
double unit_of(const Solution& solution) {
  double largest = 0;
  for (const auto& groups : solution.bounces) {
    for (const auto& values : groups) {
      for (const Rgb& b : values) {
        for (const double c : b) largest = std::isfinite(c) ? std::max(largest, std::abs(c)) : largest;
      }
    }
  }
  return largest > 0 ? largest : 1;
}

Half half_of(double value, double unit) {
  constexpr Half quiet_nan = 0x7E00;
  return std::isfinite(value) ? to_half(static_cast<float>(value / unit)) : quiet_nan;
}

/// The series in halves of `unit`, or why it is not there.
void add_bounces(Sections& sections, Json& description, const Solution& solution, const PageOptions& options) {
  if (solution.bounces.empty()) return;
  const std::size_t groups = solution.bounces.front().size(), n = solution.mesh->size();
  const std::uint64_t bytes = std::uint64_t{6} * solution.bounces.size() * groups * n;
  if (bytes > options.largest_bounces) {
    description["bounces_left_out"] = fmt::format("{} bounces of {} lamps would add {} MiB to this page",
                                                  solution.bounces.size(), groups, bytes >> 20);
    return;
  }
  const double unit = unit_of(solution);
  description["bounces"] = solution.bounces.size();
  description["bounce_unit"] = unit;
  for (std::size_t k = 0; k < solution.bounces.size(); ++k) {
    for (std::size_t g = 0; g < groups; ++g) {
      std::vector<Half> values;
      values.reserve(3 * n);
      for (const Rgb& b : solution.bounces[k][g]) {
        for (const double c : b) values.push_back(half_of(c, unit));
      }
      sections.add(fmt::format("bounce.{}.{}", k, g), values);
    }
  }
}

Json surfaces_json(const PatchMesh& mesh, const PageOptions& options) {
  Json out = Json::array();
  for (const Surface& s : mesh.surfaces) {
    const std::string material = s.material < options.materials.size() ? options.materials[s.material] : std::string();
    out.push_back({s.object.empty() ? s.group : s.object, material});
  }
  return out;
}

Json camera_json(const Camera& camera) {
  const auto list = [](Vec3 v) { return Json{v.x, v.y, v.z}; };
  return {{"eye", list(camera.eye)},
          {"target", list(camera.target)},
          {"up", list(camera.up)},
          {"fov", camera.vertical_fov}};
}

void check(const Solution& solution) {
  check_solution(solution);
  const std::size_t n = solution.mesh->size(), groups = solution.lights.names.size();
  const auto refuse = [](const char* what) { throw Error(ErrorKind::internal, fmt::format("page: {}", what)); };
  if (n == 0) refuse("no patches");
  if (groups > 0 && solution.lights.of_patch.size() != n) refuse("the light groups are of another mesh");
  if (solution.lit.size() != groups) refuse("not one solution per light group");
  const auto fits = [&](const auto& per_group, std::size_t wanted) {
    return per_group.size() == wanted &&
           std::all_of(per_group.begin(), per_group.end(), [&](const auto& values) { return values.size() == n; });
  };
  if (!fits(solution.lit, groups)) refuse("not one radiosity per patch and light group");
  for (const auto& bounce : solution.bounces) {  // without groups they are those of all lamps
    if (!fits(bounce, std::max<std::size_t>(1, groups))) refuse("not one radiosity per patch, light group and bounce");
  }
}

}  // namespace

PageData page_data(const Solution& solution, const PageOptions& options) {
  check(solution);
  const PatchMesh& mesh = *solution.mesh;
  const Vec3 origin = middle(mesh);
  constexpr double aspect = 16.0 / 9;
  Json description;
  description["title"] = options.title;
  description["patches"] = mesh.size();
  description["origin"] = {origin.x, origin.y, origin.z};
  description["camera"] = camera_json(options.camera ? *options.camera : frame_scene(mesh, aspect));
  description["surfaces"] = surfaces_json(mesh, options);
  description["lamps"] = solution.lights.names.empty() ? Json{"All lamps"} : Json(solution.lights.names);
  description["bounces"] = 0;
  description["statistics"] = options.statistics;
  if (!options.complete) description["incomplete"] = true;
  if (options.served) description["served"] = true;
  Sections sections;
  add_mesh(sections, mesh, origin);
  add_values(sections, solution);
  add_bounces(sections, description, solution, options);
  description["sections"] = std::move(sections.list());
  std::string text = description.dump(-1, ' ', false, Json::error_handler_t::replace);
  // In HTML a script ends at "</script", whatever the quotes around it: no "<" stays one.
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) text.replace(at, 1, "\\u003c");
  return {std::move(text), std::move(sections.numbers())};
}

}  // namespace interflect
