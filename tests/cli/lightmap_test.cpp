// Lightmaps through the program: the files, the exit statuses, and what Blender makes of them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "program.h"

namespace interflect::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// The JSON chunk of a GLB file.
nlohmann::json glb_json(const std::string& path) {
  const std::string bytes = content_of(path);
  std::size_t length = 0;
  for (std::size_t b = 4; b-- > 0;) length = 256 * length + static_cast<unsigned char>(bytes.at(12 + b));
  return nlohmann::json::parse(bytes.substr(20, length));
}

TEST(Lightmap, IsInTheGlbAndBesideIt) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("cornell-box.obj"), "--patches", "600", "-o", folder.file("r.glb"), "--lightmap",
                   "--lightmap-size", "256", "--lightmap-padding", "3", "--lightmap-image", folder.file("r.exr"),
                   "--lightmap-image", folder.file("r.png"), "--device", "openmp"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("lightmap       256 x 256 texels, 16 charts, "));
  EXPECT_THAT(outcome.out, HasSubstr("texels per unit, padding 3\n"));
  EXPECT_THAT(outcome.out, HasSubstr("wrote          " + folder.file("r.exr")));
  EXPECT_THAT(folder.names(), ElementsAre("r.exr", "r.glb", "r.png"));
  const nlohmann::json json = glb_json(folder.file("r.glb"));
  EXPECT_EQ(json["scenes"][0]["extras"]["interflect_lightmap"]["size"], 256);
  EXPECT_EQ(json["images"].size(), 1U);
  EXPECT_EQ(content_of(folder.file("r.png"))[24], 16);  // bits per channel
}

TEST(Lightmap, ADensityAskedForIsKept) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("furnace.obj"), "--divide", "0.1", "-o", folder.file("r.glb"), "--lightmap",
                   "--lightmap-size", "256", "--lightmap-density", "20"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("6 charts, 20 texels per unit, padding 2\n"));
  EXPECT_THAT(outcome.err, ::testing::Not(HasSubstr("coarser")));
}

TEST(Lightmap, OneThatIsCoarserThanThePatchesIsWarnedOf) {
  const Folder folder;
  const Outcome outcome = run_program({"solve", scene_file("furnace.obj"), "--patches", "3000", "-o",
                                       folder.file("r.glb"), "--lightmap", "--lightmap-size", "32"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("texels per patch (median)"));
}

struct Refused {
  int status;
  std::string words;
  std::vector<std::string> arguments;
};

TEST(Lightmap, WhatCannotBeIsRefusedBeforeTheWork) {
  const Folder folder;
  const std::string glb = folder.file("r.glb"), png = folder.file("r.png");
  const std::vector<Refused> cases{
      {2, "there is no -o FILE.glb", {"-o", folder.file("r.ply"), "--lightmap"}},
      {2,
       "r.jpg: a lightmap image is .exr or .png",
       {"-o", glb, "--lightmap", "--lightmap-image", folder.file("r.jpg")}},
      {2, "named twice", {"-o", glb, "-o", png, "--lightmap", "--lightmap-image", png}},
      {2, "--lightmap-size requires --lightmap", {"-o", glb, "--lightmap-size", "64"}},
      {2, "--lightmap-image requires --lightmap", {"-o", glb, "--lightmap-image", png}},
      {2, "'15' is not a number above 15", {"-o", glb, "--lightmap", "--lightmap-size", "15"}},
      {2, "'0' is not a number above 0", {"-o", glb, "--lightmap", "--lightmap-padding", "0"}},
      {2, "'nan' is not a number above 0", {"-o", glb, "--lightmap", "--lightmap-density", "nan"}},
      {3, "nowhere", {"-o", glb, "--lightmap", "--lightmap-image", folder.file("nowhere/r.png")}},
      {6, "does not hold 16 charts: --lightmap-size 32 does", {"-o", glb, "--lightmap", "--lightmap-size", "16"}},
      {6, "at 1000 texels per unit, nor does", {"-o", glb, "--lightmap", "--lightmap-density", "1000"}},
  };
  for (const Refused& refused : cases) {
    std::vector<std::string> arguments{"solve", scene_file("cornell-box.obj"), "--patches", "600"};
    arguments.insert(arguments.end(), refused.arguments.begin(), refused.arguments.end());
    const Outcome outcome = run_program(arguments);
    EXPECT_EQ(outcome.status, refused.status) << refused.words << "\n" << outcome.err;
    EXPECT_THAT(outcome.error_lines(), ElementsAre(HasSubstr(refused.words)));
  }
  const Outcome outcome =
      run_program({"solve", scene_file("cornell-box.obj"), "-o", glb, "--lightmap", "--lightmap-size", "8192"},
                  {"INTERFLECT_MEMORY=100M"});
  EXPECT_EQ(outcome.status, 6);
  EXPECT_THAT(outcome.err, HasSubstr("--lightmap-size 8192: the lightmap needs 2560 MiB"));
  EXPECT_THAT(folder.names(), ElementsAre());
}

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
  EXPECT_EQ(p.width, q.width);
  EXPECT_EQ(p.values.size(), q.values.size());
  Difference d;
  for (std::size_t k = 0; k < std::min(p.values.size(), q.values.size()); ++k) {
    const double off = std::abs(p.values[k] - q.values[k]);
    d.mean += off / static_cast<double>(p.values.size());
    d.most = std::max(d.most, off);
  }
  return d;
}

/// Why Blender cannot be used here; empty when it can. Fails when INTERFLECT_TEST_REQUIRE says that it must be there.
std::string why_no_blender() {
  if (std::system("command -v blender >/dev/null 2>&1") == 0) return "";
  const char* list = std::getenv("INTERFLECT_TEST_REQUIRE");
  const bool required = list != nullptr && fmt::format(",{},", list).find(",blender,") != std::string::npos;
  EXPECT_FALSE(required) << "INTERFLECT_TEST_REQUIRE names blender";
  return "blender is not installed";
}

/// Our own picture of the Cornell box from its camera, with this exposure and no curve.
void own_picture(const Folder& folder, const std::string& scene, double exposure, const std::string& name) {
  const Outcome outcome = run_program({"solve", scene, "--patches", "2000", "--form-factors", folder.file("f.iff"),
                                       "-o", folder.file(name), "--size", "256x256", "--tone", "linear", "--exposure",
                                       fmt::format("{}", exposure), "--device", "openmp", "--quiet"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
}

TEST(Lightmap, BlenderShowsTheLitRoom) {
  const std::string why = why_no_blender();
  if (!why.empty()) GTEST_SKIP() << why;
  const Folder folder;
  const std::string scene = scene_file("cornell-box.obj");
  for (const bool mapped : {false, true}) {
    std::vector<std::string> arguments{"solve",
                                       scene,
                                       "--patches",
                                       "2000",
                                       "--form-factors",
                                       folder.file("f.iff"),
                                       "--device",
                                       "openmp",
                                       "-o",
                                       folder.file(mapped ? "mapped.glb" : "coloured.glb")};
    if (mapped) arguments.insert(arguments.end(), {"--lightmap", "--lightmap-size", "512"});
    const Outcome outcome = run_program(arguments);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }
  const double scale = glb_json(folder.file("mapped.glb"))["scenes"][0]["extras"]["interflect_color_scale"];
  own_picture(folder, scene, scale, "own.png");

  const auto quoted = [&](const char* name) { return fmt::format(" '{}'", folder.file(name)); };
  const std::string command =
      fmt::format("HOME={0} XDG_CACHE_HOME={0}", quoted("home").substr(1)) +
      fmt::format(" blender -b --factory-startup -P '{}/tests/cli/blender_render.py' --", INTERFLECT_SOURCE_DIR) +
      " 256 256 278 273 -800 278 273 0 0 1 0 39.3076" + quoted("mapped.glb") + quoted("mapped.png") +
      quoted("coloured.glb") + quoted("coloured.png") + " >" + quoted("log") + " 2>&1";
  ASSERT_EQ(std::system(command.c_str()), 0) << content_of(folder.file("log"));
  EXPECT_THAT(content_of(folder.file("log")), HasSubstr("uv sets 2"));

  // Measured: 0.12 and 0.20 in the mean, 7.6 at the outline of the box.
  constexpr double mean = 0.5, most = 12;
  for (const char* name : {"mapped.png", "coloured.png"}) {
    const Difference d = difference(folder.file(name), folder.file("own.png"));
    EXPECT_LT(d.mean, mean) << name;
    EXPECT_LT(d.most, most) << name;
  }
  // Twins: other light, by as little as 5 %, is not taken for the same.
  own_picture(folder, scene, 1.05 * scale, "brighter.png");
  EXPECT_GT(difference(folder.file("mapped.png"), folder.file("brighter.png")).mean, 1.5 * mean);
  std::string materials = content_of(scene_file("cornell-box.mtl"));
  materials.replace(materials.find("17 12 4"), 7, "15 12 6");
  static_cast<void>(folder.write("cornell-box.mtl", materials));
  own_picture(folder, folder.write("other.obj", content_of(scene)), scale, "other.png");
  EXPECT_GT(difference(folder.file("mapped.png"), folder.file("other.png")).mean, 1.5 * mean);
}

}  // namespace
}  // namespace interflect::test
