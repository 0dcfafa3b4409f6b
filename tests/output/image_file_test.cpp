#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <gmock/gmock.h>
#include <png.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "interflect/base/file.h"
#include "interflect/output/output.h"
#include "interflect/output/tone.h"
#include "output/programs.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::TemporaryFolder;

/// A picture of known values: 3 wide, 2 high.
Picture sample() {
  Picture p;
  p.width = 3, p.height = 2;
  p.exposure = 0.5;
  p.pixels = {1, 0, 0, 0, 1, 0, 0, 0, 1, 2, 2, 2, 0.25F, 0.5F, 1, 1000, 1000, 1000};
  return p;
}

struct Decoded {
  std::uint32_t width = 0, height = 0;
  std::vector<std::uint8_t> bytes;
};

/// The bytes as stored: format RGB of an sRGB file asks libpng for no conversion.
Decoded read_png(const std::filesystem::path& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_file(&image, path.c_str()) == 0) {
    ADD_FAILURE() << image.message;
    return {};
  }
  image.format = PNG_FORMAT_RGB;
  Decoded out{image.width, image.height, std::vector<std::uint8_t>(PNG_IMAGE_SIZE(image))};
  EXPECT_NE(png_image_finish_read(&image, nullptr, out.bytes.data(), 0, nullptr), 0) << image.message;
  return out;
}

/// The names of a PNG file's chunks, walked by their lengths.
std::vector<std::string> png_chunks(const std::string& file) {
  std::vector<std::string> names;
  for (std::size_t at = 8; at + 12 <= file.size();) {
    std::size_t length = 0;
    for (std::size_t k = 0; k < 4; ++k) length = 256 * length + static_cast<unsigned char>(file[at + k]);
    names.push_back(file.substr(at + 4, 4));
    at += 12 + length;
  }
  return names;
}

TEST(PngTest, ReadsBackAsTheToneMappedPicture) {
  const TemporaryFolder folder;
  const Picture p = sample();
  for (const ToneMap tone : {ToneMap::linear, ToneMap::filmic}) {
    write_png(p, tone, folder / "p.png");
    const Decoded d = read_png(folder / "p.png");
    ASSERT_EQ(d.width, 3U);
    ASSERT_EQ(d.height, 2U);
    const std::uint8_t half = tone == ToneMap::linear ? 188 : srgb_byte(0.6425 / 1.0425);
    const std::uint8_t one = tone == ToneMap::linear ? 255 : srgb_byte(2.54 / 3.16);
    const std::vector<std::uint8_t> top{half, 0, 0, 0, half, 0, 0, 0, half};
    EXPECT_EQ(std::vector<std::uint8_t>(d.bytes.begin(), d.bytes.begin() + 9), top);
    EXPECT_EQ(d.bytes[9], one);
    EXPECT_EQ(d.bytes[14], half);  // blue of (0.25, 0.5, 1) at exposure 0.5
    EXPECT_EQ(d.bytes[15], 255);
  }
}

TEST(PngTest, TakesTheSamplesOwnMeanWhenItIsThere) {
  const TemporaryFolder folder;
  Picture p = sample();
  p.display.assign(p.pixels.size(), 0.5F);
  p.tone = ToneMap::linear;
  write_png(p, ToneMap::linear, folder / "p.png");
  EXPECT_THAT(read_png(folder / "p.png").bytes, ::testing::Each(188));
  write_png(p, ToneMap::filmic, folder / "p.png");  // made for another curve: from the pixels
  EXPECT_EQ(read_png(folder / "p.png").bytes[1], 0);
}

TEST(PngTest, IsMarkedAsSrgb) {
  const TemporaryFolder folder;
  write_png(sample(), ToneMap::linear, folder / "p.png");
  const auto chunks = png_chunks(read_file(folder / "p.png"));
  EXPECT_EQ(chunks.front(), "IHDR");
  EXPECT_THAT(chunks, ::testing::Contains("sRGB"));
  EXPECT_EQ(chunks.back(), "IEND");
  EXPECT_EQ(read_file(folder / "p.png")[24], 8);  // bits per channel
  EXPECT_EQ(read_file(folder / "p.png")[25], 2);  // RGB
}

TEST(ExrTest, ReadsBackAsLinearHalfFloats) {
  const TemporaryFolder folder;
  Picture p = sample();
  p.pixels[6] = 1e6F;
  p.pixels[7] = std::numeric_limits<float>::quiet_NaN();
  p.pixels[8] = 0.1F;
  write_exr(p, folder / "p.exr");
  Imf::InputFile file((folder / "p.exr").c_str());
  const auto window = file.header().dataWindow();
  ASSERT_EQ(window.max.x, 2);
  ASSERT_EQ(window.max.y, 1);
  std::vector<float> read(18);
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < 3; ++c) {
    const char* name = c == 0 ? "R" : c == 1 ? "G" : "B";
    ASSERT_NE(file.header().channels().findChannel(name), nullptr);
    EXPECT_EQ(file.header().channels().findChannel(name)->type, Imf::HALF);
    frame.insert(name, Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(read.data() + c), 12, 36));
  }
  file.setFrameBuffer(frame);
  file.readPixels(0, 1);
  for (std::size_t k = 0; k < read.size(); ++k) {
    if (k >= 6 && k < 9) continue;
    EXPECT_EQ(read[k], p.pixels[k]) << k;  // all of them have exact halves; the exposure is not applied
  }
  EXPECT_EQ(read[6], 65504);
  EXPECT_EQ(read[7], 0);
  EXPECT_NEAR(read[8], 0.1, 0.1 / 2048);
}

TEST(ExrTest, OpenExrsOwnProgramReadsIt) {
  const TemporaryFolder folder;
  write_exr(sample(), folder / "p.exr");
  const auto output = test::run_program("exrheader", "", folder / "p.exr");
  if (!output) GTEST_SKIP() << "exrheader is not installed (package openexr)";
  EXPECT_THAT(*output, ::testing::HasSubstr("R, 16-bit floating-point"));
  EXPECT_THAT(*output, ::testing::HasSubstr("dataWindow (type box2i): (0 0) - (2 1)"));
  EXPECT_THAT(*output, ::testing::HasSubstr("red   (0.64 0.33)"));
}

TEST(ImageFileTest, ALargePictureSurvives) {
  const TemporaryFolder folder;
  Picture p;
  p.width = 1021, p.height = 333;
  p.pixels.resize(3U * 1021 * 333);
  for (std::size_t k = 0; k < p.pixels.size(); ++k) p.pixels[k] = static_cast<float>((k * 2654435761U) % 1000) / 1000;
  write_png(p, ToneMap::linear, folder / "p.png");
  const Decoded d = read_png(folder / "p.png");
  for (std::size_t k = 0; k < p.pixels.size(); ++k) ASSERT_EQ(d.bytes[k], srgb_byte(p.pixels[k]));
}

}  // namespace
}  // namespace interflect
