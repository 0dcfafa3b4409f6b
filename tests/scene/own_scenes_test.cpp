#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <string>

#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/scene.h"

namespace interflect {
namespace {

namespace fs = std::filesystem;

const fs::path source = INTERFLECT_SOURCE_DIR;

Scene own(const std::string& name) {
  return read_scene(source / "scenes" / name);
}

std::string text_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  EXPECT_TRUE(file) << path;
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<std::string> findings(const Scene& scene) {
  std::vector<std::string> lines;
  for (const Finding& finding : check_scene(scene)) lines.push_back(finding.line());
  return lines;
}

/// The area of each object, and what its triangles' normals sum to (weighted with their areas).
struct Extent {
  double area = 0;
  Vec3 normals{};
};

std::map<std::string, Extent> extents(const Scene& scene) {
  std::map<std::string, Extent> out;
  for (const Triangle& t : scene.triangles) {
    const Vec3 a = scene.positions[t.vertex[0]], b = scene.positions[t.vertex[1]], c = scene.positions[t.vertex[2]];
    Extent& extent = out[scene.surfaces[t.surface].object];
    extent.area += scene.area(t);
    extent.normals += 0.5 * cross(b - a, c - a);
  }
  return out;
}

/// 1/6 Σ a · (b × c): minus the volume of the air when all fronts look into a closed room.
double signed_volume(const Scene& scene) {
  double sum = 0;
  for (const Triangle& t : scene.triangles) {
    sum += dot(scene.positions[t.vertex[0]], cross(scene.positions[t.vertex[1]], scene.positions[t.vertex[2]])) / 6;
  }
  return sum;
}

TEST(OwnScenes, TwoPlatesFaceEachOtherAtDistanceOne) {
  const Scene scene = own("two-plates.obj");
  const auto plates = extents(scene);
  ASSERT_EQ(plates.size(), 2U);
  EXPECT_DOUBLE_EQ(plates.at("lower").area, 1);
  EXPECT_DOUBLE_EQ(plates.at("upper").area, 1);
  EXPECT_DOUBLE_EQ(plates.at("lower").normals.y, 1);
  EXPECT_DOUBLE_EQ(plates.at("upper").normals.y, -1);
  const Grouping grouping = group_surfaces(scene);
  EXPECT_THAT(grouping.names, testing::UnorderedElementsAre("lower", "upper"));
  EXPECT_EQ(count_patches(scene, 0.01), 256U);
  for (const std::string& line : findings(scene)) EXPECT_THAT(line, testing::StartsWith("open edges"));
  EXPECT_TRUE(scene.camera);
}

TEST(OwnScenes, FurnaceIsAClosedCubeAlikeEverywhere) {
  const Scene scene = own("furnace.obj");
  EXPECT_THAT(findings(scene), testing::IsEmpty());
  EXPECT_DOUBLE_EQ(signed_volume(scene), -1);
  ASSERT_EQ(scene.triangles.size(), 12U);
  EXPECT_EQ(count_patches(scene, 0.01), 768U);
  for (const Triangle& t : scene.triangles) {
    const Material& material = scene.materials[scene.surfaces[t.surface].material];
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(material.emittance[c] / (1 - material.reflectance[c]), static_cast<double>(c + 1), 1e-15);
    }
  }
}

TEST(OwnScenes, CornellBoxHasThePublishedMeasurements) {
  const Scene scene = own("cornell-box.obj");
  const auto parts = extents(scene);
  ASSERT_EQ(parts.size(), 8U);
  // A quadrilateral's area is half the cross product of its diagonals; here the blocks' feet in x and z.
  const double short_foot = 0.5 * std::abs((240. - 130) * (114 - 225) - (272. - 65) * (290 - 82));
  const double tall_foot = 0.5 * std::abs((314. - 423) * (406 - 296) - (456. - 247) * (472 - 265));
  EXPECT_NEAR(parts.at("light").area, 130 * 105, 1e-9);
  EXPECT_NEAR(parts.at("ceiling").area, 556 * 559.2 - 130 * 105, 1e-9);
  EXPECT_NEAR(parts.at("floor").area, (552.8 + 549.6) / 2 * 559.2 - short_foot - tall_foot, 1e-6);
  EXPECT_NEAR(parts.at("back_wall").area, (549.6 + 556) / 2 * 548.8, 1e-6);
  EXPECT_NEAR(parts.at("right_wall").area, 559.2 * 548.8, 1e-6);
  // All fronts look into the box.
  EXPECT_NEAR(parts.at("floor").normals.y, parts.at("floor").area, 1e-6);
  EXPECT_NEAR(parts.at("ceiling").normals.y, -parts.at("ceiling").area, 1e-6);
  EXPECT_NEAR(parts.at("light").normals.y, -13650, 1e-9);
  EXPECT_NEAR(parts.at("back_wall").normals.z, -parts.at("back_wall").area, 1e-6);
  EXPECT_NEAR(parts.at("right_wall").normals.x, parts.at("right_wall").area, 1e-6);
  EXPECT_LT(parts.at("left_wall").normals.x, -306800);
  EXPECT_NEAR(parts.at("short_block").normals.y, short_foot, 1e-6);
  EXPECT_NEAR(parts.at("tall_block").normals.y, tall_foot, 1e-6);
  // Open at the front, and only there: 16 edges around the opening.
  const std::vector<Finding> found = check_scene(scene);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].severity, Finding::Severity::warning);
  EXPECT_THAT(found[0].what, testing::HasSubstr("open edges"));
  EXPECT_EQ(found[0].count, 16U);
  ASSERT_TRUE(scene.camera);
  EXPECT_EQ(scene.camera->eye, (Vec3{278, 273, -800}));
  EXPECT_NEAR(std::tan(scene.camera->vertical_fov / 2), 0.0125 / 0.035, 1e-5);
}

struct RoomCase {
  const char* file;
  std::uint64_t patches;
  std::vector<std::string> lamps;  ///< objects that emit
};

void PrintTo(const RoomCase& room, std::ostream* out) {
  *out << room.file;
}

class OwnRooms : public testing::TestWithParam<RoomCase> {};

TEST_P(OwnRooms, HasExactlyItsPatches) {
  const Scene scene = own(GetParam().file);
  EXPECT_EQ(count_patches(scene, 1), GetParam().patches);
  SubdivideOptions options;
  options.divide = 1;
  EXPECT_EQ(subdivide(scene, options).size(), GetParam().patches);
}

TEST_P(OwnRooms, IsClosedAndWithoutAnyFinding) {
  const Scene scene = own(GetParam().file);
  EXPECT_THAT(scene.warnings, testing::IsEmpty());
  EXPECT_THAT(findings(scene), testing::IsEmpty());
  // Seen from the air all fronts look inwards: minus the room's volume, plus that of the furniture.
  Vec3 low = scene.positions[0], high = low;
  for (const Vec3& p : scene.positions) low = min(low, p), high = max(high, p);
  const Vec3 size = high - low;
  EXPECT_LT(signed_volume(scene), -0.8 * size.x * size.y * size.z);
  EXPECT_GT(signed_volume(scene), -size.x * size.y * size.z);
}

TEST_P(OwnRooms, LampsHaveNamesOfTheirOwn) {
  const Scene scene = own(GetParam().file);
  std::set<std::string> lamps;
  for (const Surface& surface : scene.surfaces) {
    const Rgb e = scene.materials[surface.material].emittance;
    if (e[0] + e[1] + e[2] > 0) lamps.insert(surface.object);
  }
  EXPECT_THAT(lamps, testing::UnorderedElementsAreArray(GetParam().lamps));
}

TEST_P(OwnRooms, TheTeapotIsNewells) {
  const Scene scene = own(GetParam().file);
  Vec3 low{1e9, 1e9, 1e9}, high = -low;
  for (const Triangle& t : scene.triangles) {
    if (scene.surfaces[t.surface].object != "teapot") continue;
    for (const std::uint32_t v : t.vertex) low = min(low, scene.positions[v]), high = max(high, scene.positions[v]);
  }
  if (GetParam().patches == 1312) {  // the small room has none
    EXPECT_GT(low.x, high.x);
    return;
  }
  // From the handle (x = -3) to the tip of the spout (3.43), 4 wide, 3 high above the lowest ring of the body at 0.15.
  const Vec3 size = high - low;
  EXPECT_NEAR(size.y / size.z, 3.0 / 4.0, 0.01);
  EXPECT_NEAR(size.x / size.z, 6.43 / 4.0, 0.04);
}

TEST_P(OwnRooms, ReflectancesAreThoseOfRealThings) {
  const Scene scene = own(GetParam().file);
  for (const Material& material : scene.materials) {
    for (const double rho : material.reflectance) {
      EXPECT_GE(rho, 0.03) << material.name;
      EXPECT_LE(rho, 0.85) << material.name;
    }
  }
}

TEST_P(OwnRooms, HasACameraInside) {
  const Scene scene = own(GetParam().file);
  ASSERT_TRUE(scene.camera);
  Vec3 low = scene.positions[0], high = low;
  for (const Vec3& p : scene.positions) low = min(low, p), high = max(high, p);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_GT(scene.camera->eye[axis], low[axis]);
    EXPECT_LT(scene.camera->eye[axis], high[axis]);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, OwnRooms,
    testing::Values(RoomCase{"room-1312.obj", 1312, {"window", "ceiling_lamp", "floor_lamp"}},
                    RoomCase{"room-3360.obj", 3360, {"window", "pendant_lamp", "floor_lamp"}},
                    RoomCase{"room-9680.obj", 9680, {"window", "ceiling_lamp", "floor_lamp", "desk_lamp"}},
                    RoomCase{"room-17128.obj",
                             17128,
                             {"window_1", "window_2", "ceiling_lamp", "pendant_lamp", "floor_lamp", "desk_lamp"}}),
    [](const auto& info) { return "Room" + std::to_string(info.param.patches); });

TEST(OwnScenes, TheScriptMakesTheFilesThatAreCommitted) {
  const fs::path folder = fs::path(testing::TempDir()) / ("own_scenes_" + std::to_string(getpid()));
  const std::string command =
      "python3 '" + (source / "scripts/make-scenes.py").string() + "' '" + folder.string() + "'";
  ASSERT_EQ(std::system(command.c_str()), 0);  // NOLINT: our own script with our own path
  std::set<std::string> made, committed;
  for (const auto& entry : fs::directory_iterator(folder)) made.insert(entry.path().filename().string());
  for (const auto& entry : fs::directory_iterator(source / "scenes")) {
    const std::string extension = entry.path().extension().string();
    if (extension == ".obj" || extension == ".mtl") committed.insert(entry.path().filename().string());
  }
  EXPECT_EQ(made, committed);
  EXPECT_EQ(made.size(), 14U);
  for (const std::string& name : made) {
    EXPECT_TRUE(text_of(folder / name) == text_of(source / "scenes" / name)) << name << " differs";
  }
  fs::remove_all(folder);
}

}  // namespace
}  // namespace interflect
