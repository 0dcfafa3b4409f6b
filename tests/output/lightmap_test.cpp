#include "interflect/output/lightmap.h"

#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfInputFile.h>
#include <gmock/gmock.h>
#include <omp.h>
#include <png.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/tone.h"
#include "output/glb_read.h"
#include "output/rooms.h"
#include "output/sample_scene.h"

namespace interflect {
namespace {

using test::Sample;
using test::TemporaryFolder;

Atlas small_atlas(const PatchMesh& mesh, std::uint32_t size = 128, std::uint32_t padding = 2) {
  AtlasOptions options;
  options.size = size, options.padding = padding;
  return make_atlas(mesh, options);
}

double cross2(Vec2 a, Vec2 b, Vec2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// visit(x, y, weights of the corners) for each texel whose centre is in the triangle.
template <class Visit>
void for_texels_in(const std::array<Vec2, 3>& t, const Visit& visit) {
  const auto whole = [](double v) { return static_cast<int>(std::clamp(v, -1e6, 1e6)); };  // twins go far outside
  const auto low = [&](double a, double b, double c) { return whole(std::floor(std::min({a, b, c}))); };
  const auto high = [&](double a, double b, double c) { return whole(std::ceil(std::max({a, b, c}))); };
  const double area = cross2(t[0], t[1], t[2]);
  for (int y = low(t[0].y, t[1].y, t[2].y); y < high(t[0].y, t[1].y, t[2].y); ++y) {
    for (int x = low(t[0].x, t[1].x, t[2].x); x < high(t[0].x, t[1].x, t[2].x); ++x) {
      const Vec2 p{x + 0.5, y + 0.5};
      const std::array<double, 3> w{cross2(p, t[1], t[2]) / area, cross2(t[0], p, t[2]) / area,
                                    cross2(t[0], t[1], p) / area};
      if (*std::min_element(w.begin(), w.end()) >= 0) visit(x, y, w);
    }
  }
}

double point_to_segment(Vec2 p, Vec2 a, Vec2 b) {
  const double dx = b.x - a.x, dy = b.y - a.y, size = dx * dx + dy * dy;
  const double t = size > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / size, 0.0, 1.0) : 0;
  return std::hypot(p.x - a.x - t * dx, p.y - a.y - t * dy);
}

/// Between two triangles that do not overlap.
double distance(const std::array<Vec2, 3>& a, const std::array<Vec2, 3>& b) {
  double least = std::numeric_limits<double>::max();
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) {
      least =
          std::min({least, point_to_segment(a[k], b[l], b[(l + 1) % 3]), point_to_segment(b[k], a[l], a[(l + 1) % 3])});
    }
  }
  return least;
}

struct Faults {
  std::size_t shared_texels = 0;  ///< that two charts own
  std::size_t close_patches = 0;  ///< pairs of patches of different charts nearer than 2 * padding
  std::size_t outside = 0;        ///< corners nearer than the padding to the image's rim, or beyond it
  std::size_t wrong_size = 0;     ///< patches whose area in texels is not theirs times density²
  std::size_t texels = 0;         ///< owned by some chart: so that the above says something
};

Faults faults_of(const PatchMesh& mesh, const Atlas& atlas) {
  Faults faults;
  std::vector<std::array<Vec2, 3>> places;
  for (std::uint32_t i = 0; i < mesh.size(); ++i) places.push_back(atlas.texels(mesh, i));
  std::vector<std::uint32_t> owner(std::size_t{atlas.size} * atlas.size, 0);
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const std::uint32_t chart = atlas.charts.of_patch[i] + 1;
    for_texels_in(places[i], [&](int x, int y, const auto&) {
      std::uint32_t& o = owner.at(static_cast<std::size_t>(y) * atlas.size + static_cast<std::size_t>(x));
      faults.shared_texels += o != 0 && o != chart;
      faults.texels += o == 0;
      o = chart;
    });
    for (const Vec2 p : places[i]) {
      const double low = atlas.padding - 1e-5, high = atlas.size - low;
      faults.outside += !(p.x >= low && p.y >= low && p.x <= high && p.y <= high);
    }
    const double expected = mesh.area[i] * atlas.density * atlas.density;
    faults.wrong_size += std::abs(std::abs(cross2(places[i][0], places[i][1], places[i][2])) / 2 / expected - 1) > 4e-4;
    for (std::uint32_t j = 0; j < i; ++j) {
      if (atlas.charts.of_patch[i] == atlas.charts.of_patch[j]) continue;
      faults.close_patches += distance(places[i], places[j]) < 2 * atlas.padding - 1e-5;
    }
  }
  return faults;
}

TEST(AtlasTest, ChartsAreApartAndTrueToSize) {
  const Sample lit;
  for (const std::uint32_t padding : {1U, 2U, 5U}) {
    const Faults faults = faults_of(lit.mesh, small_atlas(lit.mesh, 128, padding));
    EXPECT_EQ(faults.shared_texels, 0U);
    EXPECT_EQ(faults.close_patches, 0U);
    EXPECT_EQ(faults.outside, 0U);
    EXPECT_EQ(faults.wrong_size, 0U);
    EXPECT_GT(faults.texels, 3500U);  // so much of the image's 16,384 is used
  }
}

/// The twin: what the test above would say of worse atlases.
TEST(AtlasTest, ChartsThatAreNotAreFound) {
  const Sample lit;
  const Atlas good = small_atlas(lit.mesh);
  Atlas moved = good;
  moved.places[1] = good.places[0];
  EXPECT_GT(faults_of(lit.mesh, moved).shared_texels, 0U);
  Atlas nearer = good;
  nearer.padding = 3;  // claims more than there is
  for (auto& place : nearer.places) --place.x, --place.y;
  EXPECT_GT(faults_of(lit.mesh, nearer).close_patches, 0U);
  EXPECT_GT(faults_of(lit.mesh, nearer).outside, 0U);
  Atlas stretched = good;
  stretched.charts.list[2].across = stretched.charts.list[2].across * 0.99;
  EXPECT_GT(faults_of(lit.mesh, stretched).wrong_size, 0U);
}

TEST(AtlasTest, TheDensityIsTheLargestThatFitsOrTheOneAskedFor) {
  const Sample lit;
  const Atlas atlas = small_atlas(lit.mesh);
  AtlasOptions options;
  options.size = 128;
  options.density = 0.8 * atlas.density;
  EXPECT_EQ(make_atlas(lit.mesh, options).density, *options.density);
  options.density = 1.5 * atlas.density;
  EXPECT_THROW(static_cast<void>(make_atlas(lit.mesh, options)), Error);
}

TEST(AtlasTest, ScaleAndPlaceDoNotMatter) {
  const Sample lit;
  const Atlas plain = small_atlas(lit.mesh);
  for (const auto& [scale, offset] : {std::pair{1e-9, 0.0}, {1e12, 0.0}, {1.0, 1e4}}) {
    Scene scene = test::sample_scene();
    for (Vec3& p : scene.positions) p = p * scale + Vec3{offset, 0, -offset};
    const test::Lit other(scene, 0.05 * scale * scale);
    const Atlas atlas = small_atlas(other.mesh);
    EXPECT_EQ(atlas.charts.list.size(), plain.charts.list.size()) << scale;
    EXPECT_NEAR(atlas.density * scale / plain.density, 1, 0.01) << scale;
    const Faults faults = faults_of(other.mesh, atlas);
    EXPECT_EQ(faults.shared_texels + faults.close_patches + faults.outside + faults.wrong_size, 0U) << scale;
  }
}

std::string refusal(const PatchMesh& mesh, const AtlasOptions& options, ErrorKind kind) {
  try {
    static_cast<void>(make_atlas(mesh, options));
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind);
    return error.what();
  }
  ADD_FAILURE() << "nothing is refused";
  return {};
}

TEST(AtlasTest, TooManyChartsAreALimitThatNamesASize) {
  const Sample lit;
  AtlasOptions options;
  options.size = 16;  // 19 charts of at least 5 x 5
  EXPECT_EQ(refusal(lit.mesh, options, ErrorKind::limit),
            "a lightmap of 16 x 16 texels does not hold 19 charts: --lightmap-size 32 does");
  options.density = 1e6;
  EXPECT_EQ(refusal(lit.mesh, options, ErrorKind::limit),
            "a lightmap of 16 x 16 texels does not hold 19 charts at 1e+06 texels per unit, nor does the largest of "
            "16384");
  const auto usage = [&](std::uint32_t size, std::uint32_t padding, double density) {
    return refusal(lit.mesh, {size, padding, density}, ErrorKind::usage);
  };
  EXPECT_THAT(usage(15, 2, 1), ::testing::HasSubstr("size of 15"));
  EXPECT_THAT(usage(16385, 2, 1), ::testing::HasSubstr("size of 16385"));
  EXPECT_THAT(usage(64, 0, 1), ::testing::HasSubstr("padding of 0"));
  EXPECT_THAT(usage(64, 65, 1), ::testing::HasSubstr("padding of 65"));
  EXPECT_THAT(usage(64, 2, std::nan("")), ::testing::HasSubstr("density"));
  EXPECT_THAT(usage(64, 2, 0), ::testing::HasSubstr("density"));
}

/// Texels in a patch (and the patches that have one) that do not hold the patch's interpolated radiosity.
struct Texels {
  std::size_t right = 0, wrong = 0;
};

Texels compare_texels(const Sample& lit, const Atlas& atlas, const std::vector<float>& pixels) {
  const auto corners = corner_radiosities(lit.mesh, lit.solution.radiosity);
  Texels texels;
  for (std::uint32_t i = 0; i < lit.mesh.size(); ++i) {
    for_texels_in(atlas.texels(lit.mesh, i), [&](int x, int y, const std::array<double, 3>& w) {
      bool right = true;
      for (std::size_t c = 0; c < 3; ++c) {
        const double expected = w[0] * corners[i][0][c] + w[1] * corners[i][1][c] + w[2] * corners[i][2][c];
        const float is = pixels.at(3 * (static_cast<std::size_t>(y) * atlas.size + static_cast<std::size_t>(x)) + c);
        right = right && std::abs(static_cast<double>(is) / expected - 1) < 1e-6;
      }
      ++(right ? texels.right : texels.wrong);
    });
  }
  return texels;
}

TEST(LightmapTest, TexelsHoldTheInterpolatedRadiosity) {
  const Sample lit;
  const Lightmap lightmap = bake_lightmap(lit.solution, small_atlas(lit.mesh));
  const Texels texels = compare_texels(lit, lightmap.atlas, lightmap.pixels);
  EXPECT_EQ(texels.wrong, 0U);
  EXPECT_GT(texels.right, 4000U);
  Atlas swapped = lightmap.atlas;  // the twin: two charts of one size have changed places
  std::swap(swapped.places[3], swapped.places[11]);
  EXPECT_GT(compare_texels(lit, swapped, lightmap.pixels).wrong, 50U);
}

/// Texels within the padding of a chart that are not of the chart's colour; each chart has one colour.
std::size_t unfilled(const PatchMesh& mesh, const Atlas& atlas, const std::vector<Rgb>& colour,
                     const std::vector<float>& pixels) {
  std::size_t wrong = 0;
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    const auto t = atlas.texels(mesh, i);
    const auto at = [&](double low) { return static_cast<std::uint32_t>(std::max(0.0, low)); };
    for (std::uint32_t y = at(t[0].y - 9); y < std::min<double>(atlas.size, t[0].y + 9); ++y) {
      for (std::uint32_t x = at(t[0].x - 9); x < std::min<double>(atlas.size, t[0].x + 9); ++x) {
        const Vec2 p{x + 0.5, y + 0.5};
        double d = std::numeric_limits<double>::max();
        for (std::size_t k = 0; k < 3; ++k) d = std::min(d, point_to_segment(p, t[k], t[(k + 1) % 3]));
        if (d > atlas.padding) continue;
        for (std::size_t c = 0; c < 3; ++c) {
          const double is = pixels[3 * (std::size_t{y} * atlas.size + x) + c];
          wrong += !(std::abs(is / colour[atlas.charts.of_patch[i]][c] - 1) < 1e-6);
        }
      }
    }
  }
  return wrong;
}

TEST(LightmapTest, ThePaddingHasTheColourOfItsChart) {
  const Sample lit;
  for (const std::uint32_t padding : {1U, 4U}) {
    const Atlas atlas = small_atlas(lit.mesh, 256, padding);
    const SmoothMesh smooth = smooth_mesh(lit.mesh);
    std::vector<Rgb> colour;
    for (std::size_t k = 0; k < atlas.charts.list.size(); ++k) colour.push_back({1.0 + double(k), 40.0 - double(k), 7});
    // Corners of their own for each patch, so that a colour ends where its chart does.
    SmoothMesh split = smooth;
    std::vector<Rgb> values;
    for (std::uint32_t i = 0; i < lit.mesh.size(); ++i) {
      split.corners[i] = {3 * i, 3 * i + 1, 3 * i + 2};
      values.insert(values.end(), 3, colour[atlas.charts.of_patch[i]]);
    }
    const std::vector<float> pixels = bake_texels(lit.mesh, split, atlas, values);
    EXPECT_EQ(unfilled(lit.mesh, atlas, colour, pixels), 0U);
    std::vector<float> bare(pixels.size(), 0.0F);  // the twin: nothing outside the patches
    for (std::uint32_t i = 0; i < lit.mesh.size(); ++i) {
      for_texels_in(atlas.texels(lit.mesh, i), [&](int x, int y, const auto&) {
        const std::size_t k = 3 * (static_cast<std::size_t>(y) * atlas.size + static_cast<std::size_t>(x));
        for (std::size_t c = 0; c < 3; ++c) bare[k + c] = pixels[k + c];
      });
    }
    EXPECT_GT(unfilled(lit.mesh, atlas, colour, bare), 100U);
  }
}

TEST(LightmapTest, TheSameBitsWhateverTheThreads) {
  const Sample lit;
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const std::string one = lightmap_png(bake_lightmap(lit.solution, small_atlas(lit.mesh)), 16);
  omp_set_num_threads(3);
  EXPECT_EQ(lightmap_png(bake_lightmap(lit.solution, small_atlas(lit.mesh)), 16), one);
  omp_set_num_threads(threads);
}

/// The values as they are stored, in a file of three channels of 16 bits that is marked as sRGB.
std::vector<std::uint16_t> read_png16(const std::filesystem::path& path) {
  const std::unique_ptr<FILE, int (*)(FILE*)> file(fopen(path.c_str(), "rb"), fclose);
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file.get());
  png_read_png(png, info, PNG_TRANSFORM_IDENTITY, nullptr);
  EXPECT_EQ(png_get_bit_depth(png, info), 16);
  EXPECT_EQ(png_get_color_type(png, info), PNG_COLOR_TYPE_RGB);
  EXPECT_NE(png_get_valid(png, info, PNG_INFO_sRGB), 0U);
  std::vector<std::uint16_t> values;
  for (std::size_t y = 0; y < png_get_image_height(png, info); ++y) {
    const png_bytep row = png_get_rows(png, info)[y];
    for (std::size_t k = 0; k < std::size_t{3} * png_get_image_width(png, info); ++k) {
      values.push_back(static_cast<std::uint16_t>(row[2 * k] << 8 | row[2 * k + 1]));
    }
  }
  png_destroy_read_struct(&png, &info, nullptr);
  return values;
}

TEST(LightmapTest, ReadsBackAsExrAndAsPngOf16Bits) {
  const TemporaryFolder folder;
  const Sample lit(1.0 / 20);
  const Lightmap lightmap = bake_lightmap(lit.solution, small_atlas(lit.mesh));
  ASSERT_EQ(lightmap.scale, 1);
  write_lightmap(lightmap, folder / "l.exr");
  write_lightmap(lightmap, folder / "l.PNG");
  EXPECT_THROW(write_lightmap(lightmap, folder / "l.jpg"), Error);
  const std::size_t count = lightmap.pixels.size();

  std::vector<float> exr(count);
  Imf::InputFile file((folder / "l.exr").c_str());
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < 3; ++c) {
    frame.insert(std::array{"R", "G", "B"}[c],
                 Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(exr.data() + c), 12, std::size_t{12} * 128));
  }
  file.setFrameBuffer(frame);
  file.readPixels(0, 127);

  const std::vector<std::uint16_t> png = read_png16(folder / "l.PNG");
  ASSERT_EQ(png.size(), count);
  for (std::size_t k = 0; k < count; ++k) {
    const double b = lightmap.pixels[k];
    ASSERT_NEAR(static_cast<double>(exr[k]), b, b / 2048) << k;
    ASSERT_NEAR(png[k], 65535 * srgb_encode(b), 0.6) << k;
  }
}

TEST(LightmapTest, BrightOnesAreScaledAndKeepTheirHue) {
  const Sample lit(100);
  const Lightmap lightmap = bake_lightmap(lit.solution, small_atlas(lit.mesh));
  EXPECT_EQ(lightmap.scale, color_scale(lit.mesh, lit.solution.radiosity));
  EXPECT_LT(lightmap.scale, 0.1);
  const std::vector<float>& p = lightmap.pixels;
  const auto brightest = static_cast<std::size_t>(std::max_element(p.begin(), p.end()) - p.begin());
  EXPECT_NEAR(p[brightest], 2000, 1e-3);  // the lamp
  const TemporaryFolder folder;
  write_lightmap(lightmap, folder / "l.png");
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  ASSERT_NE(png_image_begin_read_from_file(&image, (folder / "l.png").c_str()), 0) << image.message;
  image.format = PNG_FORMAT_RGB;
  std::vector<std::uint8_t> png(PNG_IMAGE_SIZE(image));
  ASSERT_NE(png_image_finish_read(&image, nullptr, png.data(), 0, nullptr), 0) << image.message;
  EXPECT_EQ(png[brightest], 255);
  EXPECT_NEAR(png[brightest + 1], srgb_byte(0.5), 1);
  EXPECT_NEAR(png[brightest + 2], srgb_byte(0.25), 1);
}

TEST(LightmapTest, HostileValuesStayFinite) {
  Sample lit;
  lit.solution.radiosity[0] = {std::numeric_limits<double>::quiet_NaN(), 1e300, -1};
  lit.solution.radiosity[40] = {std::numeric_limits<double>::infinity(), -1e300, 1e300};
  for (auto& b : lit.solution.radiosity) b[2] = 1e300;
  const Lightmap lightmap = bake_lightmap(lit.solution, small_atlas(lit.mesh));
  for (const float p : lightmap.pixels) ASSERT_TRUE(std::isfinite(p));
  EXPECT_FALSE(lightmap_png(lightmap, 8).empty());
}

TEST(LightmapTest, OfAnotherMeshIsRefused) {
  const Sample lit;
  const test::Lit other(test::sample_scene(), 0.5);
  EXPECT_THROW(static_cast<void>(bake_lightmap(lit.solution, small_atlas(other.mesh))), Error);
  const Lightmap lightmap = bake_lightmap(other.solution, small_atlas(other.mesh));
  const TemporaryFolder folder;
  EXPECT_THROW(write_glb(lit.solution, folder / "m.glb", &lightmap), Error);
}

}  // namespace
}  // namespace interflect
