#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/output/bytes.h"
#include "interflect/output/lens.h"
#include "interflect/output/output.h"
#include "interflect/output/sight.h"
#include "interflect/output/smooth.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

constexpr std::uint32_t largest_size = 32768;

void check_options(const PictureOptions& o) {
  const auto refuse = [](const std::string& cause) { throw Error(ErrorKind::usage, "picture: " + cause); };
  if (o.width == 0 || o.height == 0 || o.width > largest_size || o.height > largest_size) {
    refuse(fmt::format("{} x {} pixels; width and height go from 1 to {}", o.width, o.height, largest_size));
  }
  if (o.samples == 0) refuse("at least 1 sample per pixel is needed");
  if (o.exposure && !(*o.exposure > 0 && std::isfinite(*o.exposure))) refuse("the exposure must be a positive number");
}

/// A scrambled integer: where in its cell a sample lies. Depends on the pixel only, not on threads or time.
std::uint32_t scramble(std::uint32_t x) {
  x = (x ^ (x >> 16)) * 0x7feb352dU;
  x = (x ^ (x >> 15)) * 0x846ca68bU;
  return x ^ (x >> 16);
}

/// Sample s of n in a pixel: a cell of the finest square grid that has n cells or more, jittered within the cell.
class Stratified {
 public:
  explicit Stratified(std::uint32_t samples)
      : samples_(samples), side_(static_cast<std::uint32_t>(std::ceil(std::sqrt(samples)))) {}
  [[nodiscard]] Vec2 sample(std::uint32_t pixel, std::uint32_t s) const {
    if (samples_ == 1) return {0.5, 0.5};
    // Samples that do not fill the grid are spread evenly over its cells.
    const auto cell = static_cast<std::uint32_t>(std::uint64_t{s} * side_ * side_ / samples_);
    const std::uint32_t random = scramble(pixel * 0x9E3779B9U + s);
    return {(cell % side_ + (random & 0xffff) / 65536.0) / side_, (cell / side_ + (random >> 16) / 65536.0) / side_};
  }

 private:
  std::uint32_t samples_, side_;
};

class Painter {
 public:
  Painter(const Solution& solution, const PictureOptions& options)
      : mesh_(*solution.mesh), sight_(mesh_), smooth_(smooth_mesh(mesh_)) {
    for (const Rgb& b : smooth_radiosities(smooth_, mesh_, solution.radiosity)) {
      for (const double c : b) value_.push_back(std::max(finite_float(c), 0.0F));
    }
    const double aspect = static_cast<double>(options.width) / options.height;
    camera_ = options.camera ? *options.camera : frame_scene(mesh_, aspect);
  }

  [[nodiscard]] const Camera& camera() const { return camera_; }

  struct Sample {
    std::array<float, 3> radiosity{};
    bool seen = false, lamp = false;
  };
  [[nodiscard]] Sample look(Vec3 eye, Vec3 direction) const {
    const auto seen = sight_.front(eye, direction);
    if (!seen) return {};
    Sample sample{{}, true, emits(mesh_.emittance[seen->patch])};
    const auto& s = smooth_.corners[seen->patch];
    const float u = seen->u, v = seen->v, w = 1 - u - v;
    for (std::size_t c = 0; c < 3; ++c) {
      sample.radiosity[c] = w * value_[3 * s[0] + c] + u * value_[3 * s[1] + c] + v * value_[3 * s[2] + c];
    }
    return sample;
  }

 private:
  const PatchMesh& mesh_;
  Sight sight_;
  SmoothMesh smooth_;
  std::vector<float> value_;  ///< three channels per smooth vertex
  Camera camera_;
};

/// The exposure from a coarse view of the picture: what the surfaces that are not lamps show.
double view_exposure(const Painter& painter, const Lens& lens, ToneMap tone) {
  constexpr std::uint32_t across = 160, down = 90;
  std::vector<Brightness> values(across * down);
#pragma omp parallel for schedule(dynamic, 4)
  for (std::uint32_t y = 0; y < down; ++y) {
    for (std::uint32_t x = 0; x < across; ++x) {
      const auto s = painter.look(lens.eye(), lens.direction((x + 0.5) / across, (y + 0.5) / down));
      if (s.lamp || !s.seen) continue;
      values[y * across + x] = {brightness({s.radiosity[0], s.radiosity[1], s.radiosity[2]}), 1};
    }
  }
  return automatic_exposure(std::move(values), tone);
}

/// One pixel: the mean radiosity and the mean of what the screen shows of each sample.
void paint_pixel(const Painter& painter, const Lens& lens, const Stratified& grid, std::uint32_t samples,
                 std::uint32_t x, std::uint32_t y, Picture& picture) {
  const std::uint32_t pixel = y * picture.width + x;
  Rgb linear{}, display{};
  for (std::uint32_t s = 0; s < samples; ++s) {
    const Vec2 at = grid.sample(pixel, s);
    const auto sample =
        painter.look(lens.eye(), lens.direction((x + at.x) / picture.width, (y + at.y) / picture.height));
    if (!sample.seen) continue;
    Rgb exposed{};
    for (std::size_t c = 0; c < 3; ++c) {
      linear[c] += sample.radiosity[c];
      exposed[c] = picture.exposure * sample.radiosity[c];
    }
    exposed = tone_map(exposed, picture.tone);
    for (std::size_t c = 0; c < 3; ++c) display[c] += exposed[c];
  }
  for (std::size_t c = 0; c < 3; ++c) {
    picture.pixels[3 * std::size_t{pixel} + c] = static_cast<float>(linear[c] / samples);
    picture.display[3 * std::size_t{pixel} + c] = static_cast<float>(display[c] / samples);
  }
}

}  // namespace

Picture render(const Solution& solution, const PictureOptions& options) {
  check_solution(solution);
  check_options(options);
  const Painter painter(solution, options);
  const Lens lens(painter.camera(), static_cast<double>(options.width) / options.height);
  Picture picture;
  picture.width = options.width;
  picture.height = options.height;
  picture.tone = options.tone;
  picture.exposure = options.exposure ? *options.exposure : view_exposure(painter, lens, options.tone);
  picture.pixels.resize(std::size_t{3} * options.width * options.height);
  picture.display.resize(picture.pixels.size());
  const Stratified grid(options.samples);
#pragma omp parallel for schedule(dynamic, 4)
  for (std::uint32_t y = 0; y < options.height; ++y) {
    for (std::uint32_t x = 0; x < options.width; ++x) {
      paint_pixel(painter, lens, grid, options.samples, x, y, picture);
    }
  }
  return picture;
}

}  // namespace interflect
