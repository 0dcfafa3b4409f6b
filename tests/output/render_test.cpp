#include <gmock/gmock.h>
#include <omp.h>

#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/output/lens.h"
#include "interflect/output/output.h"
#include "interflect/output/tone.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;

constexpr Rgb grey{0.5, 0.5, 0.5};

PictureOptions small(const Camera& camera, std::uint32_t width = 64, std::uint32_t height = 48) {
  PictureOptions options;
  options.camera = camera;
  options.width = width;
  options.height = height;
  return options;
}

Rgb pixel(const Picture& p, std::uint32_t x, std::uint32_t y) {
  const std::size_t k = 3 * (std::size_t{y} * p.width + x);
  return {p.pixels[k], p.pixels[k + 1], p.pixels[k + 2]};
}

/// The pixel in which a camera shows a point; worked out from the pinhole model, not from Lens.
std::array<std::uint32_t, 2> project(const Camera& camera, Vec3 point, std::uint32_t width, std::uint32_t height) {
  const Vec3 forward = normalized(camera.target - camera.eye);
  const Vec3 right = normalized(cross(forward, camera.up));
  const Vec3 up = cross(right, forward);
  const Vec3 d = point - camera.eye;
  const double scale = height / (2 * std::tan(camera.vertical_fov / 2) * dot(d, forward));
  return {static_cast<std::uint32_t>(width / 2.0 + scale * dot(d, right)),
          static_cast<std::uint32_t>(height / 2.0 - scale * dot(d, up))};
}

/// A cube of side 2 around the origin, seen from within; face k has the radiosity colour(k).
SceneBuilder cube() {
  SceneBuilder s;
  const auto m = s.material(grey);
  s.box("cube", {m, m, m, m, m, m}, {-1, -1, -1}, {1, 1, 1}, true);
  return s;
}

Rgb face_colour(std::size_t face) {
  return {0.1 + 0.1 * static_cast<double>(face), 0.9 - 0.1 * static_cast<double>(face), 0.5};
}

TEST(RenderTest, AUniformRoomGivesUniformPixels) {
  Lit lit(cube().scene(), 0.1);
  lit.solution.radiosity.assign(lit.mesh.size(), {0.7, 0.5, 0.25});
  const Picture p = render(lit.solution, small({{0.3, 0.1, 0.2}, {-1, -0.4, 0.9}, {0, 1, 0}, 1.2}));
  ASSERT_EQ(p.pixels.size(), 3U * 64 * 48);
  for (std::size_t k = 0; k < p.pixels.size(); k += 3) {
    ASSERT_NEAR(p.pixels[k], 0.7, 1e-6);
    ASSERT_NEAR(p.pixels[k + 1], 0.5, 1e-6);
    ASSERT_NEAR(p.pixels[k + 2], 0.25, 1e-6);
  }
}

/// The same room, small, huge or far from the origin, gives the same picture.
TEST(RenderTest, ScaleAndPlaceDoNotMatter) {
  const auto picture = [](double scale, double offset) {
    Scene scene = cube().scene();
    for (Vec3& p : scene.positions) p = p * scale + Vec3{offset, offset, offset};
    Lit lit(scene, 0.1 * scale * scale);
    for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
      lit.solution.radiosity[i] = face_colour(lit.solution.grouping.of_surface[lit.mesh.surface[i]]);
    }
    const Vec3 origin{offset, offset, offset};
    return render(lit.solution,
                  small({origin + Vec3{0.3, 0.1, 0.2} * scale, origin + Vec3{-1, -0.4, 0.9} * scale, {0, 1, 0}, 1.2}));
  };
  const Picture plain = picture(1, 0);
  for (const auto& [scale, offset] : {std::pair{1e-12, 0.0}, {1e20, 0.0}, {1.0, 1e6}, {1.0, -1e8}}) {
    const Picture other = picture(scale, offset);
    std::size_t different = 0;  // a pixel on an edge may fall to either side
    for (std::size_t k = 0; k < plain.pixels.size(); ++k)
      different += std::abs(plain.pixels[k] - other.pixels[k]) > 0.02F;
    EXPECT_LE(different, plain.pixels.size() / 100) << scale << " " << offset;
  }
}

TEST(RenderTest, AnEyeFarAwaySeesTheSceneOrNothing) {
  SceneBuilder s;
  s.quad("square", s.material(grey), {-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0});
  Lit lit(s.scene(), 0.1);
  lit.solution.radiosity.assign(lit.mesh.size(), {0.7, 0.5, 0.25});
  for (const double distance : {1e4, 1e9, 1e25}) {  // Embree itself takes no ray from beyond 1e18
    const Picture p = render(lit.solution, small({{0, 0, distance}, {0, 0, 0}, {0, 1, 0}, 0.5 / distance}));
    EXPECT_NEAR(pixel(p, 32, 24)[0], 0.7, 1e-5) << distance;
    const Picture away = render(lit.solution, small({{0, 0, distance}, {0, 0, 2 * distance}, {0, 1, 0}, 0.5}));
    EXPECT_EQ(pixel(away, 32, 24)[0], 0) << distance;
  }
}

TEST(RenderTest, FacesHaveTheirColoursWhereTheyProject) {
  Lit lit(cube().scene(), 0.1);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    lit.solution.radiosity[i] = face_colour(lit.solution.grouping.of_surface[lit.mesh.surface[i]]);
  }
  const std::array<Vec3, 6> middle{{{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 1}}};
  const Camera camera{{0.9, 0.85, 0.8}, {-0.5, -0.5, -0.5}, {0, 1, 0}, 1.3};
  const Picture p = render(lit.solution, small(camera));
  for (const std::size_t face : {0U, 2U, 4U}) {  // those opposite to the camera
    const auto [x, y] = project(camera, middle[face], p.width, p.height);
    ASSERT_LT(x, p.width);
    ASSERT_LT(y, p.height);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(pixel(p, x, y)[c], face_colour(face)[c], 1e-6) << face;
  }
  // Right is right and up is up.
  const Picture ahead = render(lit.solution, small({{0, 0, 0.9}, {0, 0, -1}, {0, 1, 0}, 2.2}));
  EXPECT_NEAR(pixel(ahead, 63, 24)[0], face_colour(1)[0], 1e-6);
  EXPECT_NEAR(pixel(ahead, 0, 24)[0], face_colour(0)[0], 1e-6);
  EXPECT_NEAR(pixel(ahead, 32, 0)[0], face_colour(3)[0], 1e-6);
  EXPECT_NEAR(pixel(ahead, 32, 47)[0], face_colour(2)[0], 1e-6);
}

TEST(RenderTest, ShadesSmoothlyWithinAWall) {
  SceneBuilder s;
  s.quad("wall", s.material(grey), {-2, -2, 0}, {2, -2, 0}, {2, 2, 0}, {-2, 2, 0});
  Lit lit(s.scene(), 0.2);
  const auto field = [](Vec3 p) { return Rgb{3 + p.x, 3 - p.y, 2}; };
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) lit.solution.radiosity[i] = field(lit.mesh.centroid[i]);
  const Camera camera{{0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.6};  // shows |x|, |y| < 1 or so
  const Picture p = render(lit.solution, small(camera, 100, 75));
  const double size = 2 * 3 * std::tan(0.3) / 75;  // of a pixel on the wall
  double from_flat = 0;
  for (std::uint32_t y = 0; y < p.height; ++y) {
    for (std::uint32_t x = 0; x < p.width; ++x) {
      const Vec3 at{(x + 0.5 - 50) * size, (37.0 - y) * size, 0};
      // The samples' mean lies within a pixel of its middle: half a pixel, times the field's slope of 1.
      ASSERT_NEAR(pixel(p, x, y)[0], field(at)[0], size / 2);
      ASSERT_NEAR(pixel(p, x, y)[1], field(at)[1], size / 2);
    }
  }
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    for (const Vec3 corner : lit.mesh.triangle(i)) {
      from_flat = std::max(from_flat, std::abs(lit.solution.radiosity[i][0] - field(corner)[0]));
    }
  }
  EXPECT_GT(from_flat, 2 * size);  // patches of one colour would have failed above
}

TEST(RenderTest, OneLooksThroughBacks) {
  Lit lit(cube().scene(), 0.5);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    lit.solution.radiosity[i] = face_colour(lit.solution.grouping.of_surface[lit.mesh.surface[i]]);
  }
  const Picture p = render(lit.solution, small({{0, 0, 9}, {0, 0, 0}, {0, 1, 0}, 0.5}));
  EXPECT_NEAR(pixel(p, 32, 24)[0], face_colour(4)[0], 1e-6);  // the far wall, through the near one
  EXPECT_EQ(pixel(p, 0, 0), (Rgb{}));                         // past the cube: black
}

TEST(RenderTest, BothSidesOfATwoSidedSheetAreSeen) {
  SceneBuilder s;
  s.quad("sheet", s.material(grey, {}, true), {-2, -2, 0}, {2, -2, 0}, {2, 2, 0}, {-2, 2, 0});
  Lit lit(s.scene(), 0.1);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const Vec3 p = lit.mesh.centroid[i];
    lit.solution.radiosity[i] = lit.mesh.normal[i].z > 0 ? Rgb{1, 0, 0} : Rgb{0, 3 + p.x, 3 + p.y};
  }
  const Picture front = render(lit.solution, small({{0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.6}));
  const Picture back = render(lit.solution, small({{0, 0, -3}, {0, 0, 0}, {0, 1, 0}, 0.6}));
  const double size = 2 * 3 * std::tan(0.3) / 48;
  for (std::uint32_t y = 0; y < 48; ++y) {
    for (std::uint32_t x = 0; x < 64; ++x) {
      ASSERT_EQ(pixel(front, x, y), (Rgb{1, 0, 0}));
      // From behind, x runs to the left. A patch's weights taken in the other side's order would show here.
      ASSERT_NEAR(pixel(back, x, y)[1], 3 + (31.5 - x) * size, size);
      ASSERT_NEAR(pixel(back, x, y)[2], 3 + (23.5 - y) * size, size);
    }
  }
}

TEST(RenderTest, EdgesAreAntiAliased) {
  SceneBuilder s;
  s.quad("sheet", s.material(grey), {-1, -5, 0}, {0.013, -5, 0}, {0.013, 5, 0}, {-1, 5, 0});
  Lit lit(s.scene(), 0);
  lit.solution.radiosity.assign(lit.mesh.size(), {1, 1, 1});
  const auto between = [&](std::uint32_t samples) {
    PictureOptions options = small({{0, 0, 3}, {0.2, 0, 0}, {0.1, 1, 0}, 0.6});
    options.samples = samples;
    const Picture p = render(lit.solution, options);
    return std::count_if(p.pixels.begin(), p.pixels.end(), [](float v) { return v > 0.01F && v < 0.99F; });
  };
  EXPECT_GT(between(16), 3 * 40);
  EXPECT_GT(between(5), 3 * 30);
  EXPECT_EQ(between(1), 0);
}

TEST(RenderTest, RadiositiesThatAreNoNumbersDoNotSpread) {
  Lit lit(cube().scene(), 0.5);
  lit.solution.radiosity.assign(lit.mesh.size(), {0.7, 0.5, 0.25});
  lit.solution.radiosity[3] = {std::numeric_limits<double>::quiet_NaN(), 1, 1};
  lit.solution.radiosity[4] = {1, std::numeric_limits<double>::infinity(), 1};
  lit.solution.radiosity[5] = {-5, 1e300, 1};
  PictureOptions options = small({{0.3, 0.1, 0.2}, {-1, -0.4, 0.9}, {0, 1, 0}, 1.2});
  for (const ToneMap tone : {ToneMap::linear, ToneMap::filmic}) {
    options.tone = tone;
    const Picture p = render(lit.solution, options);
    EXPECT_TRUE(std::isfinite(p.exposure) && p.exposure > 0);
    for (const float v : p.pixels) ASSERT_TRUE(std::isfinite(v) && v >= 0);
    for (const float v : p.display) ASSERT_TRUE(v >= 0 && v <= 1);
  }
}

TEST(RenderTest, ThePictureDoesNotDependOnTheNumberOfThreads) {
  Lit lit(cube().scene(), 0.1);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) lit.solution.radiosity[i] = face_colour(i % 7);
  const int before = omp_get_max_threads();
  const auto with_threads = [&](int n) {
    omp_set_num_threads(n);
    const Picture p = render(lit.solution, small({{0.3, 0.1, 0.2}, {-1, -0.4, 0.9}, {0, 1, 0}, 1.2}));
    omp_set_num_threads(before);
    return p;
  };
  const Picture one = with_threads(1), three = with_threads(3);
  EXPECT_EQ(one.pixels, three.pixels);
  EXPECT_EQ(one.display, three.display);
  EXPECT_EQ(one.exposure, three.exposure);
}

TEST(RenderTest, AutomaticExposureKeepsWallsBelowWhiteWhereLampsClip) {
  SceneBuilder s;
  const auto wall = s.material(grey), lamp = s.material(grey, {500, 500, 500});
  s.box("cube", {wall, wall, wall, lamp, wall, wall}, {-1, -1, -1}, {1, 1, 1}, true);
  Lit lit(s.scene(), 0.1);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const double b = emits(lit.mesh.emittance[i]) ? 500 : 2 + lit.mesh.centroid[i].y;
    lit.solution.radiosity[i] = {b, b, b};
  }
  PictureOptions options = small({{0, 0, 0.9}, {0, 0, -1}, {0, 1, 0}, 2.0});
  for (const ToneMap tone : {ToneMap::linear, ToneMap::filmic}) {
    options.tone = tone;
    options.exposure.reset();
    const Picture p = render(lit.solution, options);
    const auto shown = [&](std::uint32_t x, std::uint32_t y) { return p.display[3 * (std::size_t{y} * p.width + x)]; };
    EXPECT_EQ(shown(32, 0), 1);  // the ceiling is the lamp
    for (std::uint32_t x = 0; x < p.width; ++x) {
      EXPECT_LT(shown(x, 24), 0.9);
      EXPECT_GT(shown(x, 24), 0.1);
    }
    options.exposure = 0.125;
    const Picture asked = render(lit.solution, options);
    EXPECT_EQ(asked.exposure, 0.125);
    EXPECT_EQ(asked.pixels, p.pixels);
    EXPECT_NEAR(asked.display[3 * (24 * 64 + 32)], tone_curve(0.125 * pixel(p, 32, 24)[0], tone), 1e-3);
  }
}

ErrorKind refusal(const PictureOptions& options) {
  Lit lit(cube().scene(), 0);
  try {
    (void)render(lit.solution, options);
  } catch (const Error& error) {
    return error.kind();
  }
  ADD_FAILURE() << "not refused";
  return ErrorKind::internal;
}

TEST(RenderTest, RefusesOptionsThatMakeNoSense) {
  const Camera good{{0, 0, 0.5}, {0, 0, -1}, {0, 1, 0}, 1};
  const auto with = [&](auto change) {
    PictureOptions options = small(good, 4, 4);
    change(options);
    return refusal(options);
  };
  static constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(with([](auto& o) { o.width = 0; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.height = 40000; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.samples = 0; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.exposure = -1; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.exposure = nan; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.camera->eye.x = nan; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.camera->target = o.camera->eye; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.camera->vertical_fov = 4; }), ErrorKind::usage);
  EXPECT_EQ(with([](auto& o) { o.camera->vertical_fov = 0; }), ErrorKind::usage);
}

TEST(RenderTest, ACameraThatLooksStraightUpStillSeesSomething) {
  Lit lit(cube().scene(), 0.5);
  lit.solution.radiosity.assign(lit.mesh.size(), {0.7, 0.5, 0.25});
  const Picture p = render(lit.solution, small({{0, 0, 0}, {0, 1, 0}, {0, 1, 0}, 1}));
  for (std::size_t k = 0; k < p.pixels.size(); k += 3) ASSERT_NEAR(p.pixels[k], 0.7, 1e-6);
}

}  // namespace
}  // namespace interflect
