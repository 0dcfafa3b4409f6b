#include <gmock/gmock.h>

#include <cmath>

#include "interflect/output/lens.h"
#include "interflect/output/output.h"
#include "interflect/output/sight.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;

constexpr Rgb grey{0.5, 0.5, 0.5}, bright{9, 9, 9};
constexpr double aspect = 16.0 / 9;

/// Shares of a picture's rays that meet fronts and backs first, and the share that meets a group.
struct Shares {
  double front = 0, back = 0;
  std::vector<double> group;
};
Shares look(const Lit& lit, const Camera& camera, double width_over_height = aspect) {
  constexpr int across = 80, down = 45;
  const Sight sight(lit.mesh);
  const Lens lens(camera, width_over_height);
  Shares shares{0, 0, std::vector<double>(lit.solution.grouping.names.size(), 0)};
  for (int k = 0; k < across * down; ++k) {
    const auto seen = sight.first(camera.eye, lens.direction((k % across + 0.5) / across, (k / across + 0.5) / down));
    if (!seen) continue;
    (seen->front ? shares.front : shares.back) += 1.0 / (across * down);
    shares.group[lit.solution.grouping.of_surface[lit.mesh.surface[seen->patch]]] += 1.0 / (across * down);
  }
  return shares;
}

bool within(Vec3 p, Vec3 low, Vec3 high) {
  return p.x > low.x && p.y > low.y && p.z > low.z && p.x < high.x && p.y < high.y && p.z < high.z;
}

/// A room of 8 x 3 x 5 with a lamp under the ceiling and a cupboard that fills a third of it; up is y or z.
SceneBuilder room(bool z_up, double scale = 1) {
  SceneBuilder s;
  const auto wall = s.material(grey), lamp = s.material(grey, bright), wood = s.material({0.4, 0.2, 0.1});
  const auto v = [&](double x, double up, double z) {
    return z_up ? Vec3{x * scale, z * scale, up * scale} : Vec3{x * scale, up * scale, z * scale};
  };
  s.box("room", {wall, wall, wall, wall, wall, wall}, v(0, 0, 0), v(8, 3, 5), true);
  const unsigned all_but_bottom = z_up ? 0b101111U : 0b111011U;
  s.box("lamp", {lamp, lamp, lamp, lamp, lamp, lamp}, v(3, 2.9, 2), v(5, 2.95, 3), false, all_but_bottom);
  s.box("cupboard", {wood, wood, wood, wood, wood, wood}, v(0.5, 0.01, 0.5), v(3, 2.5, 4.5), false);
  return s;
}

TEST(FrameTest, StandsInsideARoomAndOutsideItsFurniture) {
  for (const bool z_up : {false, true}) {
    const Lit lit(room(z_up).scene(), 0.5);
    const Camera camera = frame_scene(lit.mesh, aspect);
    EXPECT_EQ(camera.up, (z_up ? Vec3{0, 0, 1} : Vec3{0, 1, 0}));
    const auto v = [&](double x, double up, double z) { return z_up ? Vec3{x, z, up} : Vec3{x, up, z}; };
    EXPECT_TRUE(within(camera.eye, v(0, 0.9, 0), v(8, 2.3, 5))) << camera.eye.x;
    EXPECT_FALSE(within(camera.eye, v(0.4, 0, 0.4), v(3.1, 2.6, 4.6)));
    const Shares shares = look(lit, camera);
    EXPECT_GT(shares.front, 0.999);
    EXPECT_EQ(shares.back, 0);
    double cupboard = 0;
    for (std::size_t g = 0; g < shares.group.size(); ++g) {
      if (lit.solution.grouping.names[g].starts_with("cupboard")) cupboard += shares.group[g];
    }
    EXPECT_GT(cupboard, 0.03);  // the one thing to see in there
    EXPECT_GE(camera.vertical_fov, 1.0);
    EXPECT_LE(camera.vertical_fov, 1.3);
  }
}

TEST(FrameTest, TheSceneMayHaveAnySize) {
  const Lit metres(room(false).scene(), 0.5), millimetres(room(false, 1000).scene(), 0.5e6);
  const Camera a = frame_scene(metres.mesh, aspect), b = frame_scene(millimetres.mesh, aspect);
  EXPECT_NEAR(length(b.eye - a.eye * 1000), 0, 1);
}

TEST(FrameTest, IsDeterministic) {
  const Lit lit(room(false).scene(), 0.5);
  const Camera a = frame_scene(lit.mesh, aspect), b = frame_scene(lit.mesh, aspect);
  EXPECT_EQ(a.eye, b.eye);
  EXPECT_EQ(a.target, b.target);
}

TEST(FrameTest, LooksIntoABoxThroughItsOpenSide) {
  for (unsigned open = 0; open < 6; ++open) {
    if (open == 2 || open == 3) continue;  // floor and ceiling
    SceneBuilder s;
    const auto wall = s.material(grey), lamp = s.material(grey, bright);
    s.box("room", {wall, wall, wall, wall, wall, wall}, {0, 0, 0}, {5.5, 5.4, 5.6}, true, 1U << open);
    s.box("lamp", {lamp, lamp, lamp, lamp, lamp, lamp}, {2, 5.3, 2}, {3, 5.35, 3}, false, 0b111011);
    s.box("block", {wall, wall, wall, wall, wall, wall}, {2, 0, 2}, {3, 3, 3}, false, 0b100);
    const Lit lit(s.scene(), 0.5);
    for (const double wide : {16.0 / 9, 1.0, 0.5}) {
      const Camera camera = frame_scene(lit.mesh, wide);
      const Vec3 low{0, 0, 0}, high{5.5, 5.4, 5.6};
      EXPECT_FALSE(within(camera.eye, low, high));
      const int axis = static_cast<int>(open / 2);
      if (open % 2 == 0) {
        EXPECT_LT(camera.eye[axis], low[axis]);
      } else {
        EXPECT_GT(camera.eye[axis], high[axis]);
      }
      const Shares shares = look(lit, camera, wide);
      EXPECT_LT(shares.back, 0.02 * shares.front);
      EXPECT_GT(shares.front, 0.3);
      EXPECT_LT(shares.front, 0.95);  // with some room around the box
    }
  }
}

TEST(FrameTest, SeesTheFrontsOfTwoPlates) {
  SceneBuilder s;
  const auto m = s.material(grey), lamp = s.material(grey, bright);
  s.quad("floor", m, {0, 0, 0}, {0, 0, 1}, {1, 0, 1}, {1, 0, 0});
  s.quad("ceiling", lamp, {0, 1, 0}, {1, 1, 0}, {1, 1, 1}, {0, 1, 1});
  const Lit lit(s.scene(), 0.1);
  const Shares shares = look(lit, frame_scene(lit.mesh, aspect));
  EXPECT_GT(shares.group[0], 0.03);
  EXPECT_GT(shares.group[1], 0.03);
  EXPECT_LT(shares.back, 0.01);
}

TEST(FrameTest, SeesASingleTriangleFromItsFront) {
  for (const Vec3 apex : {Vec3{0, 1, 0}, Vec3{0, 0, 1}, Vec3{0, 0, -1}, Vec3{0, -1, 0}}) {
    SceneBuilder s;
    s.triangle(s.surface_of("triangle", s.material(grey)), {0, 0, 0}, {1, 0, 0}, apex);
    const Lit lit(s.scene(), 0);
    const Shares shares = look(lit, frame_scene(lit.mesh, aspect));
    EXPECT_GT(shares.front, 0.05);
    EXPECT_EQ(shares.back, 0);
  }
}

}  // namespace
}  // namespace interflect
