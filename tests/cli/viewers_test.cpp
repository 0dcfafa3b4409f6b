// The GLB of the Cornell box in programs that no one here wrote: what they show is compared with our own picture.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::HasSubstr;

/// An 8-bit picture, as means over squares of 8 x 8 pixels: what two programs make of an edge's pixels may differ.
struct Small {
  std::size_t width = 0, height = 0;
  std::vector<double> values;
};

Small small_picture(const std::string& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_file(&image, path.c_str()), 0) << path << ": " << image.message;
  image.format = PNG_FORMAT_RGB;
  std::vector<std::uint8_t> bytes(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, bytes.data(), 0, nullptr), 0) << path << ": " << image.message;
  constexpr std::size_t square = 8;
  Small small{image.width / square, image.height / square, {}};
  small.values.assign(3 * small.width * small.height, 0);
  for (std::size_t y = 0; y < small.height * square; ++y) {
    for (std::size_t x = 0; x < small.width * square; ++x) {
      for (std::size_t c = 0; c < 3; ++c) {
        small.values[3 * (y / square * small.width + x / square) + c] +=
            bytes[3 * (y * image.width + x) + c] / double(square * square);
      }
    }
  }
  return small;
}

/// Differences of two pictures in units of 1/255.
struct Difference {
  double mean = 0, most = 0;
};

Difference difference(const std::string& a, const std::string& b) {
  const Small p = small_picture(a), q = small_picture(b);
  EXPECT_EQ(p.width, 32U);
  EXPECT_EQ(q.width, 32U);
  EXPECT_EQ(p.values.size(), 3072U);
  EXPECT_EQ(q.values.size(), 3072U);
  Difference d;
  for (std::size_t k = 0; k < std::min(p.values.size(), q.values.size()); ++k) {
    const double off = std::abs(p.values[k] - q.values[k]);
    d.mean += off / static_cast<double>(p.values.size());
    d.most = std::max(d.most, off);
  }
  return d;
}

// What a viewer's picture may differ by. Measured: Blender 0.12 (lightmap) and 0.20 (colours at the vertices) in the
// mean, three.js 0.42 in both; 7.6 at most, at the outline of the box.
constexpr double mean_allowed = 0.7, most_allowed = 12;

/// The Cornell box with a lightmap and with colours at its vertices, and our own picture of it from its camera.
class Viewers : public testing::Test {
 protected:
  /// Whether the program is there. Fails when it is not and INTERFLECT_TEST_REQUIRE says that it must be.
  static bool is_there(const std::string& program) {
    if (std::system(fmt::format("command -v {} >/dev/null 2>&1", program).c_str()) == 0) return true;
    const char* list = std::getenv("INTERFLECT_TEST_REQUIRE");
    const bool required = list != nullptr && fmt::format(",{},", list).find("," + program + ",") != std::string::npos;
    EXPECT_FALSE(required) << program << " is not installed, and INTERFLECT_TEST_REQUIRE names it";
    return false;
  }

  void make_files() {
    solve(scene, {"-o", folder.file("coloured.glb")});
    solve(scene, {"-o", folder.file("mapped.glb"), "--lightmap", "--lightmap-size", "512"});
    const auto json = nlohmann::json::parse(glb_text(folder.file("mapped.glb")));
    scale = json["scenes"][0]["extras"]["interflect_color_scale"];
    picture(scene, scale, "own.png");
  }

  void solve(const std::string& file, std::vector<std::string> more) const {
    std::vector<std::string> arguments{
        "solve", file, "--patches", "2000", "--form-factors", folder.file("f.iff"), "--device", "openmp", "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = run_program(arguments);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }
  void picture(const std::string& file, double exposure, const std::string& name) const {
    solve(file, {"-o", folder.file(name), "--size", "256x256", "--tone", "linear", "--exposure",
                 fmt::format("{}", exposure)});
  }

  /// A command's output and errors; a failure when it does not end with 0.
  [[nodiscard]] std::string run(const std::string& command) const {
    // The browser's own Vulkan driver is not to be hidden, as drivers are from these tests.
    const std::string environment = fmt::format(
        "env -u VK_ICD_FILENAMES -u VK_DRIVER_FILES HOME={0} XDG_CACHE_HOME={0} XDG_CONFIG_HOME={0} ", quoted("home"));
    EXPECT_EQ(std::system((environment + command + " >" + quoted("log") + " 2>&1 </dev/null").c_str()), 0) << command;
    return content_of(folder.file("log"));
  }
  [[nodiscard]] std::string quoted(const std::string& name) const { return fmt::format("'{}'", folder.file(name)); }

  /// Both pictures show the lit room, and the comparison tells other light from it.
  void expect_lit() const {
    for (const char* name : {"mapped.png", "coloured.png"}) {
      const Difference d = difference(folder.file(name), folder.file("own.png"));
      EXPECT_LT(d.mean, mean_allowed) << name;
      EXPECT_LT(d.most, most_allowed) << name;
      RecordProperty(name, fmt::format("{:.3f} {:.2f}", d.mean, d.most));
    }
    picture(scene, 1.05 * scale, "brighter.png");
    EXPECT_GT(difference(folder.file("mapped.png"), folder.file("brighter.png")).mean, 1.5 * mean_allowed);
    std::string materials = content_of(scene_file("cornell-box.mtl"));
    materials.replace(materials.find("17 12 4"), 7, "15 12 6");
    static_cast<void>(folder.write("cornell-box.mtl", materials));
    picture(folder.write("other.obj", content_of(scene)), scale, "other.png");
    EXPECT_GT(difference(folder.file("mapped.png"), folder.file("other.png")).mean, 1.5 * mean_allowed);
  }

  const Folder folder;
  const std::string scene = scene_file("cornell-box.obj");
  double scale = 0;
};

TEST_F(Viewers, BlenderShowsTheLitRoom) {
  if (!is_there("blender")) GTEST_SKIP() << "blender is not installed";
  make_files();
  const std::string log =
      run(fmt::format("blender -b --factory-startup -P '{}/tests/cli/blender_render.py' -- 256 256 278 273 -800 278 "
                      "273 0 0 1 0 39.3076 "
                      "{} {} {} {}",
                      INTERFLECT_SOURCE_DIR, quoted("mapped.glb"), quoted("mapped.png"), quoted("coloured.glb"),
                      quoted("coloured.png")));
  ASSERT_TRUE(std::filesystem::exists(folder.file("coloured.png"))) << log;
  EXPECT_THAT(log, HasSubstr("uv sets 2"));
  expect_lit();
}

std::string base64(const std::string& bytes) {
  static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    std::uint32_t three = 0;
    for (std::size_t b = 0; b < 3; ++b) {
      three = three << 8U | (k + b < bytes.size() ? static_cast<unsigned char>(bytes[k + b]) : 0U);
    }
    for (std::size_t d = 0; d < 4; ++d) {
      out += k + d > bytes.size() ? '=' : digits[three >> (18 - 6 * d) & 63U];
    }
  }
  return out;
}

void replace_all(std::string& text, const std::string& what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size()) {
    text.replace(at, what.size(), by);
  }
}

TEST_F(Viewers, ThreeJsShowsTheLitRoom) {
  const std::string three = "/usr/share/javascript/three";
  if (!is_there("chromium")) GTEST_SKIP() << "chromium is not installed";
  if (!std::filesystem::exists(three + "/three.min.js")) GTEST_SKIP() << "three.js is not installed (libjs-three)";
  make_files();
  for (const std::string name : {"mapped", "coloured"}) {
    std::string page = content_of(std::string(INTERFLECT_SOURCE_DIR) + "/tests/cli/three_render.html");
    replace_all(page, "@THREE@", three);
    replace_all(page, "@GLB@", base64(content_of(folder.file(name + ".glb"))));
    const std::string log =
        run(fmt::format("timeout 120 chromium --headless --no-sandbox --use-gl=angle --use-angle=swiftshader "
                        "--enable-unsafe-swiftshader --user-data-dir={} --enable-logging=stderr --hide-scrollbars "
                        "--window-size=256,256 --virtual-time-budget=10000 --screenshot={} 'file://{}'",
                        quoted("chromium"), quoted(name + ".png"), folder.write(name + ".html", page)));
    EXPECT_THAT(log, HasSubstr(name == "mapped" ? "MeshBasicMaterial: position normal uv uv2 _radiosity"
                                                : "MeshBasicMaterial: position normal color _radiosity"));
    EXPECT_EQ(log.find("failed: "), std::string::npos) << log;
    EXPECT_THAT(log, HasSubstr(" triangles"));
    ASSERT_TRUE(std::filesystem::exists(folder.file(name + ".png"))) << log;
  }
  expect_lit();
}

}  // namespace
}  // namespace interflect::test
