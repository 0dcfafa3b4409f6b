// A solved GLB comes back as what was written, and damage is named.
#include <gmock/gmock.h>

#include <cstring>
#include <fstream>
#include <functional>
#include <numeric>

#include "interflect/base/error.h"
#include "interflect/output/lit_mesh.h"
#include "interflect/output/renderer.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;
using test::TemporaryFolder;
using ::testing::HasSubstr;

/// A box with a lamp below its ceiling; radiosities that differ everywhere.
std::unique_ptr<Lit> room() {
  SceneBuilder s;
  const auto wall = s.material({0.5, 0.4, 0.3}), lamp = s.material({0.1, 0.1, 0.1}, {9, 8, 7});
  s.box("room", {wall, wall, wall, wall, wall, wall}, {0, 0, 0}, {3, 2.5, 4}, true);
  s.box("lamp", {lamp, lamp, lamp, lamp, lamp, lamp}, {1, 2, 1}, {2, 2.2, 2}, false);
  auto lit = std::make_unique<Lit>(s.scene(), 0.3);
  for (std::size_t i = 0; i < lit->mesh.size(); ++i) {
    const Vec3 p = lit->mesh.centroid[i];
    const double e = lit->mesh.emittance[i][0];
    lit->solution.radiosity[i] = {0.2 + 0.1 * p.x + e, 0.3 + 0.1 * p.y + e, 0.1 + 0.05 * p.z + e};
  }
  return lit;
}

PictureOptions view() {
  PictureOptions options;
  options.camera = Camera{{0.3, 1.2, 0.3}, {2, 1.5, 2.5}, {0, 1, 0}, 1.1};
  options.width = 160, options.height = 120;
  return options;
}

TEST(SolvedGlb, GivesThePictureThatTheSolutionGives) {
  const TemporaryFolder folder;
  const auto lit = room();
  write_glb(lit->solution, folder / "room.glb");
  const auto back = read_solved_glb(folder / "room.glb");
  ASSERT_TRUE(back);
  EXPECT_GT(back->mesh.size(), lit->mesh.size()) << "patches are cut where finer ones meet them";
  const auto whole = [](const PatchMesh& mesh) { return std::accumulate(mesh.area.begin(), mesh.area.end(), 0.0); };
  EXPECT_NEAR(whole(back->mesh), whole(lit->mesh), 1e-5 * whole(lit->mesh));
  const Picture before = render(lit->solution, view()), after = Renderer(*back).render(view());
  // Lamps do not count for the exposure: so the file must know them.
  EXPECT_NEAR(after.exposure, before.exposure, 1e-3 * before.exposure);
  std::size_t different = 0;
  for (std::size_t k = 0; k < before.pixels.size(); ++k) {
    different += std::abs(before.pixels[k] - after.pixels[k]) > 1e-3F ? 1 : 0;
  }
  EXPECT_LE(different, before.pixels.size() / 1000);  // a float's rounding may move an edge
}

/// The bytes of the solved file, changed, and the line that reading it gives.
std::string error_of(const std::function<void(std::string&)>& damage) {
  const TemporaryFolder folder;
  write_glb(room()->solution, folder / "room.glb");
  std::ifstream in(folder / "room.glb", std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), {});
  damage(bytes);
  std::ofstream(folder / "bad.glb", std::ios::binary) << bytes;
  try {
    return read_solved_glb(folder / "bad.glb") ? "read" : "not ours";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
}

void replace(std::string& bytes, const std::string& from, const std::string& to) {
  ASSERT_EQ(from.size(), to.size());
  for (auto at = bytes.find(from); at != std::string::npos; at = bytes.find(from, at + 1))
    bytes.replace(at, from.size(), to);
}

TEST(SolvedGlb, DamageIsNamed) {
  EXPECT_EQ(error_of([](std::string&) {}), "read");
  EXPECT_THAT(error_of([](std::string& b) { replace(b, "\"_RADIOSITY\"", "\"_RADIOSITX\""); }),
              AllOf(HasSubstr("bad.glb"), HasSubstr("_RADIOSITY is missing")));
  // The file ends with the last primitive's _EMITTANCE and indices; a number in the middle of all is a radiosity or
  // position, and NaN is neither.
  EXPECT_THAT(error_of([](std::string& b) {
                for (std::size_t k = b.size() / 2 & ~std::size_t{3}; k < b.size() / 2 + 4000; ++k) b[k] = '\xff';
              }),
              HasSubstr("bad.glb"));
  EXPECT_THAT(error_of([](std::string& b) { b.resize(b.size() / 2); }), HasSubstr("truncated"));
  EXPECT_EQ(error_of([](std::string& b) {
              replace(b, "\"_RADIOSITY\"", "\"_RADIOSITX\"");
              replace(b, "\"Interflect\"", "\"Interflecx\"");
            }),
            "not ours");
}

}  // namespace
}  // namespace interflect
