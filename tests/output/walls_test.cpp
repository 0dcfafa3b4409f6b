// Patches that go on under walls and cabinets: light and dark stay apart.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "interflect/output/cut_parts.h"
#include "interflect/output/hanging.h"
#include "interflect/output/lightmap.h"
#include "interflect/output/renderer.h"
#include "interflect/output/smooth.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;

constexpr Rgb grey{0.5, 0.5, 0.5}, dark_grey{0.3, 0.3, 0.3};
constexpr double bright = 1, dim = 0.05;

/// A floor 4 x 3 that goes on under a wall at x = 1.9, which is `thick`; its patches have what a solve gives them: the
/// mean over the patch of a light side (1) and a dark one (0.05).
class FloorUnderWall {
 public:
  explicit FloorUnderWall(double thick, double divide = 0.2, double foot = 0) : lit_(scene(thick, foot), divide) {
    for (std::size_t i = 0; i < lit_.mesh.size(); ++i) {
      double share = 0;  // of the patch on the light side, by counting
      const auto t = lit_.mesh.triangle(i);
      constexpr int n = 40;
      int all = 0;
      for (int u = 0; u < n; ++u) {
        for (int v = 0; u + v < n; ++v, ++all) {
          share += exact(t[0] + (t[1] - t[0]) * ((u + 0.3) / n) + (t[2] - t[0]) * ((v + 0.3) / n));
        }
      }
      const double mean = share / all;
      lit_.solution.radiosity[i] = {mean, mean, mean};
    }
  }

  static double exact(Vec3 p) { return p.x < 1.9 ? bright : dim; }

  /// The largest error of the picture from above, over pixels of the floor that are not within `near` of the wall.
  [[nodiscard]] double error(bool walls, double near) const {
    PictureOptions options;
    options.camera = Camera{{2, 5, 1.5}, {2, 0, 1.5}, {0, 0, -1}, 0.5};
    options.width = 240, options.height = 180, options.exposure = 1;
    const Picture picture = Renderer(lit_.solution, walls).render(options);
    const double size = 2 * 5 * std::tan(0.25) / options.height;
    double worst = 0;
    for (std::uint32_t y = 0; y < picture.height; ++y) {
      for (std::uint32_t x = 0; x < picture.width; ++x) {
        const Vec3 p{2 + (x + 0.5 - picture.width / 2.0) * size, 0, 1.5};
        if (std::abs(p.x - 1.9) < near) continue;
        const double b = static_cast<double>(picture.pixels[3 * (std::size_t{y} * picture.width + x)]);
        worst = std::max(worst, std::abs(b - exact(p)));
      }
    }
    return worst;
  }
  /// The largest error of the floor's lightmap, over texels that are not within `near` of the wall.
  [[nodiscard]] double lightmap_error(bool walls, double near) const {
    const PatchMesh& mesh = lit_.mesh;
    AtlasOptions options;
    options.size = 256;
    const Atlas atlas = make_atlas(mesh, options);
    const SmoothMesh smooth = smooth_mesh(mesh, smooth_crease, walls);
    const auto pixels = bake_texels(mesh, smooth, atlas, smooth_radiosities(smooth, mesh, lit_.solution.radiosity));
    const auto floor = static_cast<std::uint32_t>(
        std::find_if(mesh.normal.begin(), mesh.normal.end(), [](Vec3 n) { return n.y > 0.9; }) - mesh.normal.begin());
    const std::uint32_t k = atlas.charts.of_patch[floor];
    const Chart& chart = atlas.charts.list[k];
    const Atlas::Place place = atlas.places[k];
    double worst = 0;
    for (std::uint32_t y = 0; y < place.height; ++y) {
      for (std::uint32_t x = 0; x < place.width; ++x) {
        const double across = (x + 0.5 - atlas.padding) / atlas.density,
                     down = (y + 0.5 - atlas.padding) / atlas.density;
        const Vec3 p = chart.origin + chart.across * across + chart.down * down;
        if (std::abs(p.x - 1.9) < near) continue;
        const auto b = static_cast<double>(pixels[3 * (std::size_t{place.y + y} * atlas.size + place.x + x)]);
        worst = std::max(worst, std::abs(b - exact(p)));
      }
    }
    return worst;
  }
  [[nodiscard]] const PatchMesh& mesh() const { return lit_.mesh; }

 private:
  static Scene scene(double thick, double foot) {
    SceneBuilder s;
    const auto floor = s.material(grey), wall = s.material(dark_grey, {}, thick == 0);
    s.quad("floor", floor, {0, 0, 0}, {0, 0, 3}, {4, 0, 3}, {4, 0, 0});
    if (thick == 0) {
      s.quad("wall", wall, {1.9, foot, -0.1}, {1.9, foot, 3.1}, {1.9, 0.5, 3.1}, {1.9, 0.5, -0.1});
    } else {
      s.box("wall", {wall, wall, wall, wall, wall, wall}, {1.9 - thick / 2, foot, -0.1}, {1.9 + thick / 2, 0.5, 3.1},
            false);
    }
    return s.scene();
  }
  Lit lit_;
};

TEST(Walls, LightDoesNotLeakUnderAWallThatCutsThePatches) {
  for (const double thick : {0.0, 0.1}) {
    const FloorUnderWall room(thick);
    const double near = thick == 0 ? 0.03 : 0.1;  // the wall itself, its top seen in perspective
    EXPECT_LT(room.error(true, near), 1e-5) << thick;
    EXPECT_GT(room.error(false, near), 0.2) << thick;  // without the mask
  }
}

TEST(Walls, NorDoesItInALightmap) {
  for (const double thick : {0.0, 0.1}) {
    const FloorUnderWall room(thick);
    const double near = thick / 2 + 0.01;
    EXPECT_LT(room.lightmap_error(true, near), 1e-5) << thick;
    EXPECT_GT(room.lightmap_error(false, near), 0.2) << thick;  // without the mask
  }
}

TEST(Walls, AWallThatOnlyTouchesTheFloorOrGoesThroughItCounts) {
  for (const double foot : {0.0, -0.3, 1e-6}) EXPECT_LT(FloorUnderWall(0, 0.2, foot).error(true, 0.03), 1e-5) << foot;
  // One that ends above it does not: light passes below.
  EXPECT_GT(FloorUnderWall(0, 0.2, 0.2).error(true, 0.03), 0.2);
}

/// Two triangles for the whole floor: no patch tells what either side has, and nothing worse than the mean is shown.
TEST(Walls, WithoutAPatchOfOneSideTheMeanIsShown) {
  const FloorUnderWall room(0, 100);
  EXPECT_LT(room.error(true, 0.03), 0.6);
}

std::size_t cuts(const Scene& scene, double divide) {
  const Lit lit(scene, divide);
  return smooth_mesh(lit.mesh).walls.size();
}

TEST(Walls, OnlyWhatSeparatesAPatchCutsIt) {
  const auto scene = [](Vec3 low, Vec3 high) {
    SceneBuilder s;
    const auto m = s.material(grey), n = s.material(dark_grey);
    s.quad("floor", m, {0, 0, 0}, {0, 0, 4}, {4, 0, 4}, {4, 0, 0});
    s.box("box", {n, n, n, n, n, n}, low, high, false);
    return s.scene();
  };
  EXPECT_EQ(cuts(scene({1.20, 0, 1.75}, {1.24, 1, 1.79}), 2), 0U);  // a table's leg in the middle of a patch
  EXPECT_EQ(cuts(scene({1.3, 0.1, 1.3}, {1.5, 1, 1.5}), 2), 0U);    // hovers
  EXPECT_EQ(cuts(scene({1.3, -1, 1.3}, {1.5, 0, 1.5}), 2), 0U);     // below the floor
  EXPECT_GT(cuts(scene({0.7, 0, 0.9}, {2.9, 1, 3.1}), 2), 0U);      // a cabinet over several patches
}

TEST(Walls, MeshesThatFitTogetherAreNotCut) {
  for (const char* name : {"room-1312.obj", "cornell-box.obj"}) {
    const Scene scene = read_scene(std::string(INTERFLECT_SOURCE_DIR) + "/scenes/" + name);
    SubdivideOptions options;
    options.divide = name[0] == 'r' ? 1 : 4000;
    const PatchMesh mesh = subdivide(scene, options);
    EXPECT_EQ(smooth_mesh(mesh).walls.size(), 0U) << name;
  }
}

/// A wall along edges of the floor's patches that has no vertex in common with them.
TEST(Walls, AWallBesideEdgesKeepsLightApart) {
  SceneBuilder s;
  const auto m = s.material(grey);
  s.quad("left", m, {0, 0, 0}, {0, 0, 1}, {1, 0, 1}, {1, 0, 0});
  s.quad("right", m, {1, 0, 0}, {1, 0, 1}, {2, 0, 1}, {2, 0, 0});
  s.quad("wall", s.material(dark_grey, {}, true), {1, 0, -0.37}, {1, 0, 1.21}, {1, 1, 1.21}, {1, 1, -0.37});
  Lit lit(s.scene(), 0.01);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const double b = lit.mesh.centroid[i].x < 1 ? 1 : 9;
    lit.solution.radiosity[i] = {b, b, b};
  }
  const auto leak = [&](bool walls) {
    const SmoothMesh smooth = smooth_mesh(lit.mesh, smooth_crease, walls);
    const std::vector<Rgb> value = smooth_radiosities(smooth, lit.mesh, lit.solution.radiosity);
    double most = 0;
    for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
      if (lit.mesh.centroid[i].y > 0.001) continue;
      for (const std::uint32_t c : smooth.corners[i]) {
        most = std::max(most, std::abs(value[c][0] - lit.solution.radiosity[i][0]));
      }
    }
    return most;
  };
  EXPECT_LT(leak(true), 1e-12);
  EXPECT_GT(leak(false), 2);
}

TEST(CutParts, ACornerOnAWallBelongsToNoSide) {
  // From corner a to the middle of bc.
  const auto cut = cut_of({{Vec2{0, 0}, Vec2{0.5, 0.5}}}, {1, 0, 0}, {0, 1, 0});
  ASSERT_TRUE(cut);
  EXPECT_EQ(cut->part[0], 0);
  EXPECT_EQ(cut->part[1], 2);
  EXPECT_EQ(cut->part[2], 4);
  EXPECT_NEAR(cut->share[1], 0.5, 0.05);
  EXPECT_EQ(cut->corners_at(0.5, 0.1), 2);
  EXPECT_EQ(cut->corners_at(0.1, 0.5), 4);
}

TEST(CutParts, AWallThatEndsInThePatchDoesNotCutIt) {
  EXPECT_FALSE(cut_of({{Vec2{0.3, 0}, Vec2{0.3, 0.3}}}, {1, 0, 0}, {0, 1, 0}));
  EXPECT_TRUE(cut_of({{Vec2{0.3, 0}, Vec2{0.3, 0.7}}}, {1, 0, 0}, {0, 1, 0}));
  // In two pieces that meet.
  EXPECT_TRUE(cut_of({{Vec2{0.3, 0}, Vec2{0.3, 0.4}}, {Vec2{0.3, 0.4}, Vec2{0.3, 0.7}}}, {1, 0, 0}, {0, 1, 0}));
}

}  // namespace
}  // namespace interflect
