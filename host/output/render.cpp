#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/output/lens.h"
#include "interflect/output/output.h"
#include "interflect/output/sight.h"
#include "interflect/output/smooth.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

constexpr std::uint32_t largest_size = 32768;
constexpr double largest_value = 1e30;  // so that sums over samples stay finite floats

void check_options(const PictureOptions& o) {
  const auto refuse = [](const std::string& cause) { throw Error(ErrorKind::usage, "picture: " + cause); };
  if (o.width == 0 || o.height == 0 || o.width > largest_size || o.height > largest_size) {
    refuse(fmt::format("{} x {} pixels; width and height go from 1 to {}", o.width, o.height, largest_size));
  }
  if (o.samples == 0) refuse("at least 1 sample per pixel is needed");
  if (o.exposure && !(*o.exposure > 0 && std::isfinite(*o.exposure))) refuse("the exposure must be a positive number");
}

/// Where the samples of a pixel lie: the Hammersley points, one in each of n columns and rows and, for n = 4^k, in each
/// cell of the 2^k x 2^k grid. The same in every pixel, so that straight edges come out even. The first `scouts` of
/// them, if there are more, lie in different quarters of the columns and of the rows.
constexpr std::size_t scouts = 4;

std::vector<Vec2> sample_points(std::uint32_t n) {
  std::vector<Vec2> points;
  for (std::uint32_t s = 0; s < n; ++s) {
    double y = 0.5 / n, digit = 0.5;
    for (std::uint32_t bits = s; bits != 0; bits >>= 1U, digit /= 2) y += bits & 1U ? digit : 0;
    points.push_back({(s + 0.5) / n, std::min(y, 1.0)});
  }
  constexpr std::array<Vec2, scouts> wanted{{{0.125, 0.375}, {0.375, 0.875}, {0.625, 0.125}, {0.875, 0.625}}};
  for (std::size_t k = 0; k < scouts && points.size() > scouts; ++k) {
    const auto far = [&](Vec2 p) { return std::hypot(p.x - wanted[k].x, p.y - wanted[k].y); };
    const auto rest = points.begin() + static_cast<std::ptrdiff_t>(k);
    std::iter_swap(rest, std::min_element(rest, points.end(), [&](Vec2 p, Vec2 q) { return far(p) < far(q); }));
  }
  return points;
}

class Painter {
 public:
  Painter(const Solution& solution, const PictureOptions& options)
      : mesh_(*solution.mesh), sight_(mesh_), smooth_(smooth_mesh(mesh_)) {
    for (const Rgb& b : smooth_radiosities(smooth_, mesh_, solution.radiosity)) {
      for (const double c : b) value_.push_back(static_cast<float>(std::clamp(c, 0.0, largest_value)));
    }
    const double aspect = static_cast<double>(options.width) / options.height;
    camera_ = options.camera ? *options.camera : frame_scene(mesh_, aspect);
  }

  [[nodiscard]] const Camera& camera() const { return camera_; }

  static constexpr std::uint32_t nothing = ~0U;
  struct Sample {
    std::array<float, 3> radiosity{};
    std::uint32_t patch = nothing;
    bool lamp = false;
  };
  [[nodiscard]] Sample look(Vec3 eye, Vec3 direction) const {
    const auto seen = sight_.front(eye, direction);
    if (!seen) return {};
    Sample sample{{}, seen->patch, emits(mesh_.emittance[seen->patch])};
    const auto& s = smooth_.corners[seen->patch];
    const float u = seen->u, v = seen->v, w = 1 - u - v;
    for (std::size_t c = 0; c < 3; ++c) {
      sample.radiosity[c] = w * value(s[0], c) + u * value(s[1], c) + v * value(s[2], c);
    }
    return sample;
  }

 private:
  [[nodiscard]] float value(std::size_t vertex, std::size_t channel) const { return value_[3 * vertex + channel]; }

  const PatchMesh& mesh_;
  Sight sight_;
  SmoothMesh smooth_;
  std::vector<float> value_;  ///< three channels per smooth vertex
  Camera camera_;
};

/// The exposure from a coarse view of the picture: what the surfaces that are not lamps show.
double view_exposure(const Painter& painter, const Lens& lens, ToneMap tone) {
  constexpr std::uint32_t across = 160, down = 90;
  std::vector<Brightness> values(std::size_t{across} * down);
#pragma omp parallel for schedule(dynamic, 4)
  for (std::uint32_t y = 0; y < down; ++y) {
    for (std::uint32_t x = 0; x < across; ++x) {
      const auto s = painter.look(lens.eye(), lens.direction((x + 0.5) / across, (y + 0.5) / down));
      if (s.lamp || s.patch == Painter::nothing) continue;
      values[y * across + x] = {brightness({s.radiosity[0], s.radiosity[1], s.radiosity[2]}), 1};
    }
  }
  return automatic_exposure(std::move(values), tone);
}

/// One pixel: the mean radiosity, and the mean of what the screen shows of each sample. A pixel whose first samples all
/// see one patch needs no more: radiosity is linear there.
void paint_pixel(const Painter& painter, const Lens& lens, const std::vector<Vec2>& points, std::uint32_t x,
                 std::uint32_t y, Picture& picture) {
  Rgb linear{}, display{};
  bool uniform = true;
  std::uint32_t patch = Painter::nothing, done = 0;
  for (const Vec2 at : points) {
    if (done == scouts && uniform) break;
    const auto sample =
        painter.look(lens.eye(), lens.direction((x + at.x) / picture.width, (y + at.y) / picture.height));
    uniform = uniform && (done == 0 || sample.patch == patch);
    patch = sample.patch;
    ++done;
    Rgb exposed{};
    for (std::size_t c = 0; c < 3; ++c) {
      linear[c] += static_cast<double>(sample.radiosity[c]);
      exposed[c] = picture.exposure * static_cast<double>(sample.radiosity[c]);
    }
    exposed = tone_map(exposed, picture.tone);
    for (std::size_t c = 0; c < 3; ++c) display[c] += exposed[c];
  }
  const std::size_t first = std::size_t{3} * (std::size_t{y} * picture.width + x);
  for (std::size_t c = 0; c < 3; ++c) {
    picture.pixels[first + c] = static_cast<float>(linear[c] / done);
    picture.display[first + c] = static_cast<float>(display[c] / done);
  }
}

}  // namespace

Picture render(const Solution& solution, const PictureOptions& options, ProgressSink* progress) {
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
  const std::vector<Vec2> points = sample_points(options.samples);
  if (progress != nullptr) progress->begin("Picture", options.height);
#pragma omp parallel for schedule(dynamic, 4)
  for (std::uint32_t y = 0; y < options.height; ++y) {
    for (std::uint32_t x = 0; x < options.width; ++x) {
      paint_pixel(painter, lens, points, x, y, picture);
    }
    if (progress != nullptr) progress->advance(1);
  }
  if (progress != nullptr) progress->end();
  return picture;
}

}  // namespace interflect
