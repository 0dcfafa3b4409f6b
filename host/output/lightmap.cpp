#include "interflect/output/lightmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/bytes.h"
#include "interflect/output/png_file.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

using Weights = std::array<double, 3>;

Vec2 minus(Vec2 a, Vec2 b) {
  return {a.x - b.x, a.y - b.y};
}
double dot2(Vec2 a, Vec2 b) {
  return a.x * b.x + a.y * b.y;
}

/// A patch in the image: answers where its nearest point to a texel's centre is.
class Flat {
 public:
  explicit Flat(const Triangle2& corners)
      : corners_(corners),
        b_(minus(corners[1], corners[0])),
        c_(minus(corners[2], corners[0])),
        twice_area_(b_.x * c_.y - b_.y * c_.x) {}

  /// The weights of the corners at the nearest point to p, and the square of its distance: 0 inside.
  double nearest(Vec2 p, Weights& weights) const {
    if (twice_area_ != 0) {
      const Vec2 d = minus(p, corners_[0]);
      const double b = (d.x * c_.y - d.y * c_.x) / twice_area_, c = (b_.x * d.y - b_.y * d.x) / twice_area_;
      weights = {1 - b - c, b, c};
      if (weights[0] >= 0 && b >= 0 && c >= 0) return 0;
    }
    double least = std::numeric_limits<double>::max();
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t l = (k + 1) % 3;
      const Vec2 along = minus(corners_[l], corners_[k]), d = minus(p, corners_[k]);
      const double size = dot2(along, along);
      const double t = size > 0 ? std::clamp(dot2(d, along) / size, 0.0, 1.0) : 0;
      const Vec2 off = minus(d, along * t);
      const double distance = dot2(off, off);
      if (distance >= least) continue;
      least = distance;
      weights = {};
      weights[k] = 1 - t, weights[l] = t;
    }
    return least;
  }

 private:
  Triangle2 corners_;
  Vec2 b_, c_;
  double twice_area_;
};

/// Fills a chart's texels patch by patch; of several patches the nearest one decides, of equally near ones the first.
class ChartBaker {
 public:
  ChartBaker(const Atlas& atlas, std::uint32_t chart, std::vector<float>& pixels)
      : atlas_(atlas),
        place_(atlas.places[chart]),
        pixels_(pixels),
        distance_(std::size_t{place_.width} * place_.height, std::numeric_limits<float>::max()) {}

  /// `cut`: where walls stand on the patch, or null.
  void add(const Triangle2& corners, const std::array<Rgb, 3>& values, const Cut* cut) {
    const Flat flat(corners);
    const double reach = atlas_.padding + 1.0;
    const auto [left, right] = texels(corners[0].x, corners[1].x, corners[2].x, reach, place_.x, place_.width);
    const auto [top, bottom] = texels(corners[0].y, corners[1].y, corners[2].y, reach, place_.y, place_.height);
    Weights weights{};
    for (std::uint32_t y = top; y < bottom; ++y) {
      for (std::uint32_t x = left; x < right; ++x) {
        float& best = distance_[std::size_t{y - place_.y} * place_.width + (x - place_.x)];
        if (best == 0) continue;
        const double distance = flat.nearest({x + 0.5, y + 0.5}, weights);
        if (static_cast<float>(distance) >= best) continue;
        best = static_cast<float>(distance);
        if (cut != nullptr) weights = cut->shares(weights);
        float* const pixel = pixels_.data() + 3 * (std::size_t{y} * atlas_.size + x);
        for (std::size_t c = 0; c < 3; ++c) {
          pixel[c] = finite_float(weights[0] * values[0][c] + weights[1] * values[1][c] + weights[2] * values[2][c]);
        }
      }
    }
  }

 private:
  /// The texels of [first, first + count) that lie within `reach` of the extent of three coordinates.
  static std::pair<std::uint32_t, std::uint32_t> texels(double a, double b, double c, double reach, std::uint32_t first,
                                                        std::uint32_t count) {
    const double low = std::floor(std::min({a, b, c}) - reach), high = std::ceil(std::max({a, b, c}) + reach);
    const double end = double(first) + count;
    return {static_cast<std::uint32_t>(std::clamp(low, double(first), end)),
            static_cast<std::uint32_t>(std::clamp(high, double(first), end))};
  }

  const Atlas& atlas_;
  const Atlas::Place place_;
  std::vector<float>& pixels_;
  std::vector<float> distance_;  ///< per texel of the place: square of the distance to the chart so far
};

/// The image as a screen shows it, sRGB-encoded, `bits` per channel, most significant byte first.
std::vector<std::uint8_t> screen_bytes(const Lightmap& lightmap, int bits) {
  const std::size_t bytes = static_cast<std::size_t>(bits) / 8;
  const double most = bits == 16 ? 65535 : 255;
  std::vector<std::uint8_t> out(lightmap.pixels.size() * bytes);
#pragma omp parallel for
  for (std::size_t k = 0; k < lightmap.pixels.size(); k += 3) {
    Rgb colour{};
    for (std::size_t c = 0; c < 3; ++c) colour[c] = lightmap.scale * static_cast<double>(lightmap.pixels[k + c]);
    colour = tone_map(colour, ToneMap::linear);
    for (std::size_t c = 0; c < 3; ++c) {
      const auto value = static_cast<std::uint32_t>(std::lround(most * srgb_encode(colour[c])));
      std::uint8_t* const at = out.data() + (k + c) * bytes;
      if (bytes == 2) *at = static_cast<std::uint8_t>(value >> 8U);
      at[bytes - 1] = static_cast<std::uint8_t>(value & 255U);
    }
  }
  return out;
}

}  // namespace

std::vector<float> bake_texels(const PatchMesh& mesh, const SmoothMesh& smooth, const Atlas& atlas,
                               const std::vector<Rgb>& values) {
  std::vector<float> pixels(3 * std::size_t{atlas.size} * atlas.size, 0.0F);
  const auto charts = static_cast<std::int64_t>(atlas.charts.list.size());
#pragma omp parallel for schedule(dynamic)  // charts share no texel
  for (std::int64_t k = 0; k < charts; ++k) {
    const auto chart = static_cast<std::uint32_t>(k);
    ChartBaker baker(atlas, chart, pixels);
    for (const std::uint32_t i : atlas.charts.list[chart].patches) {
      const auto& corners = smooth.corners[i];
      baker.add(atlas.texels(mesh, i), {values[corners[0]], values[corners[1]], values[corners[2]]},
                smooth.walls.cut(i));
    }
  }
  return pixels;
}

Lightmap bake_lightmap(const Solution& solution, Atlas atlas) {
  check_solution(solution);
  const PatchMesh& mesh = *solution.mesh;
  if (atlas.charts.of_patch.size() != mesh.size()) {
    throw Error(ErrorKind::internal, "output: an atlas of another mesh");
  }
  const SmoothMesh smooth = smooth_mesh(mesh);
  std::vector<float> pixels = bake_texels(mesh, smooth, atlas, smooth_radiosities(smooth, mesh, solution.radiosity));
  return {std::move(atlas), std::move(pixels), color_scale(mesh, solution.radiosity)};
}

std::string lightmap_png(const Lightmap& lightmap, int bits) {
  if (bits != 8 && bits != 16) throw Error(ErrorKind::internal, fmt::format("output: a PNG of {} bits", bits));
  return encode_png({lightmap.atlas.size, lightmap.atlas.size, bits, screen_bytes(lightmap, bits)});
}

void write_lightmap(const Lightmap& lightmap, const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  if (extension == ".png") {
    AtomicFile file(path);
    file.write(lightmap_png(lightmap, 16));
    file.commit();
  } else if (extension == ".exr") {
    const Picture picture{lightmap.atlas.size, lightmap.atlas.size, lightmap.pixels, lightmap.scale, {},
                          ToneMap::linear};
    write_exr(picture, path);
  } else {
    throw Error(ErrorKind::usage, fmt::format("{}: a lightmap image is .exr or .png", path.string()));
  }
}

std::uint64_t lightmap_bytes(std::uint32_t size) {
  // The texels in single precision with their distances, a copy, and those of a 16-bit file, plain and packed.
  return std::uint64_t{size} * size * (12 + 4 + 12 + 6 + 6);
}

}  // namespace interflect
