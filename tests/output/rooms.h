#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "interflect/output/output.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect::test {

/// Scenes made of quads, for tests: a quad a b c d is seen from the front counter-clockwise.
class SceneBuilder {
 public:
  std::uint32_t material(Rgb reflectance, Rgb emittance = {}, bool two_sided = false) {
    Material m;
    m.name = "material " + std::to_string(scene_.materials.size());
    m.reflectance = reflectance;
    m.emittance = emittance;
    m.two_sided = two_sided;
    scene_.materials.push_back(m);
    return static_cast<std::uint32_t>(scene_.materials.size() - 1);
  }
  void quad(const std::string& name, std::uint32_t material, Vec3 a, Vec3 b, Vec3 c, Vec3 d) {
    const std::uint32_t surface = surface_of(name, material);
    triangle(surface, a, b, c);
    triangle(surface, a, c, d);
  }
  void triangle(std::uint32_t surface, Vec3 a, Vec3 b, Vec3 c) {
    Triangle t;
    const auto first = static_cast<std::uint32_t>(scene_.positions.size());
    t.vertex = {first, first + 1, first + 2};
    t.surface = surface;
    scene_.triangles.push_back(t);
    scene_.positions.insert(scene_.positions.end(), {a, b, c});
  }
  std::uint32_t surface_of(const std::string& name, std::uint32_t material) {
    scene_.surfaces.push_back({name, name, material});
    return static_cast<std::uint32_t>(scene_.surfaces.size() - 1);
  }
  /// The six faces of a box, named NAME.0 to NAME.5 (x low, x high, y low, ...), one material each; fronts inwards or
  /// outwards; `skip` leaves faces out (bit k).
  void box(const std::string& name, const std::vector<std::uint32_t>& materials, Vec3 low, Vec3 high, bool inwards,
           unsigned skip = 0) {
    for (unsigned face = 0; face < 6; ++face) {
      if (skip >> face & 1U) continue;
      const unsigned axis = face / 2;
      const auto at = [&](bool u, bool v) {
        double p[3];
        p[axis] = (face % 2 ? high : low)[static_cast<int>(axis)];
        p[(axis + 1) % 3] = (u ? high : low)[static_cast<int>((axis + 1) % 3)];
        p[(axis + 2) % 3] = (v ? high : low)[static_cast<int>((axis + 2) % 3)];
        return Vec3{p[0], p[1], p[2]};
      };
      const Vec3 a = at(false, false), b = at(true, false), c = at(true, true), d = at(false, true);
      const std::string face_name = name + "." + std::to_string(face);
      // Counter-clockwise about +axis; the low face looks inwards that way, the high face outwards.
      if ((face % 2 == 0) == inwards) {
        quad(face_name, materials[face], a, b, c, d);
      } else {
        quad(face_name, materials[face], a, d, c, b);
      }
    }
  }
  [[nodiscard]] const Scene& scene() const { return scene_; }
  Scene& scene() { return scene_; }

 private:
  Scene scene_;
};

/// A mesh with a radiosity per patch, kept together.
struct Lit {
  PatchMesh mesh;
  Solution solution;

  Lit(const Scene& scene, double divide) {
    SubdivideOptions options;
    options.divide = divide;
    mesh = subdivide(scene, options);
    solution.mesh = &mesh;
    solution.grouping = group_surfaces(scene, GroupBy::object);
    solution.radiosity.assign(mesh.size(), Rgb{});
    solution.row_sum.assign(mesh.size(), 1);
  }
  Lit(const Lit&) = delete;
  Lit& operator=(const Lit&) = delete;
};

/// A folder that only this test of this process uses; removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    path_ = std::filesystem::path(::testing::TempDir()) / name(info->test_suite_name(), info->name());
    std::filesystem::create_directories(path_);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  /// Names of parameterised tests hold slashes.
  static std::string name(std::string suite, const std::string& test) {
    suite = "interflect-" + suite + "-" + test + "-" + std::to_string(getpid());
    std::replace(suite.begin(), suite.end(), '/', '-');
    return suite;
  }
  std::filesystem::path path_;
};

}  // namespace interflect::test
