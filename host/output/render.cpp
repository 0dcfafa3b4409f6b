#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/output/lens.h"
#include "interflect/output/output.h"
#include "interflect/output/painter.h"
#include "interflect/output/renderer.h"
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

/// What the samples of a pixel add up to.
struct Sum {
  Rgb linear{}, display{};
  std::uint32_t count = 0;
};

/// One picture in the making: painted tile by tile, so that rays that are traced together run close together.
class Canvas {
 public:
  Canvas(const Painter& painter, const Lens& lens, const PictureOptions& options, Picture& picture)
      : painter_(painter), lens_(lens), points_(sample_points(options.samples)), picture_(picture) {
    first_ = std::min(points_.size(), scouts);
  }

  static constexpr std::uint32_t tile = 8;  // pixels, both ways

  /// What a thread works with.
  struct Bench {
    std::vector<Vec3> directions;
    std::vector<Painter::Sample> samples;
    std::vector<std::array<std::uint32_t, 2>> pixels;  ///< that need all samples
    std::vector<Sum> sums;                             ///< of what they have
  };

  void paint(std::uint32_t left, std::uint32_t top, Bench& bench) const {
    const std::uint32_t right = std::min(left + tile, picture_.width), bottom = std::min(top + tile, picture_.height);
    bench.directions.clear(), bench.pixels.clear(), bench.sums.clear();
    for (std::uint32_t y = top; y < bottom; ++y) {
      for (std::uint32_t x = left; x < right; ++x) aim(x, y, 0, first_, bench);
    }
    look(bench);
    std::span<const Painter::Sample> samples = bench.samples;
    for (std::uint32_t y = top; y < bottom; ++y) {
      for (std::uint32_t x = left; x < right; ++x, samples = samples.subspan(first_)) {
        const auto mine = samples.first(first_);
        const bool even = first_ > 1 && alike(mine);
        const Sum sum = even ? add_alike(mine) : add(mine, {});
        if (first_ == points_.size() || even || one_patch(mine)) {
          put(x, y, sum);
        } else {
          bench.pixels.push_back({x, y});
          bench.sums.push_back(sum);
        }
      }
    }
    paint_rest(bench);
  }

 private:
  void aim(std::uint32_t x, std::uint32_t y, std::size_t from, std::size_t to, Bench& bench) const {
    for (std::size_t s = from; s < to; ++s) {
      bench.directions.push_back(
          lens_.direction((x + points_[s].x) / picture_.width, (y + points_[s].y) / picture_.height));
    }
  }
  void look(Bench& bench) const {
    bench.samples.resize(bench.directions.size());
    painter_.look(lens_.eye(), bench.directions, bench.samples);
  }

  void paint_rest(Bench& bench) const {
    if (bench.pixels.empty()) return;
    bench.directions.clear();
    for (const auto& [x, y] : bench.pixels) aim(x, y, first_, points_.size(), bench);
    look(bench);
    const std::size_t each = points_.size() - first_;
    for (std::size_t k = 0; k < bench.pixels.size(); ++k) {
      const auto mine = std::span<const Painter::Sample>(bench.samples).subspan(k * each, each);
      put(bench.pixels[k][0], bench.pixels[k][1], add(mine, bench.sums[k]));
    }
  }

  static bool one_patch(std::span<const Painter::Sample> samples) {
    return std::all_of(samples.begin(), samples.end(), [&](const auto& s) { return s.patch == samples[0].patch; });
  }

  /// Whether the samples see one surface in nearly one colour: then more of them would not change what a screen shows.
  [[nodiscard]] bool alike(std::span<const Painter::Sample> samples) const {
    constexpr float share = 0.02F, dark = 0.002F;  // of the brightest channel; of the screen's white
    std::array<float, 3> low = samples[0].radiosity, high = low;
    for (const auto& s : samples) {
      if (s.surface != samples[0].surface) return false;
      for (std::size_t c = 0; c < 3; ++c) {
        low[c] = std::min(low[c], s.radiosity[c]), high[c] = std::max(high[c], s.radiosity[c]);
      }
    }
    const float brightest = std::max({high[0], high[1], high[2]});
    const float range = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
    return range <= share * brightest || range * static_cast<float>(picture_.exposure) <= dark;
  }

  [[nodiscard]] Rgb shown(const Rgb& linear) const {
    return tone_map({picture_.exposure * linear[0], picture_.exposure * linear[1], picture_.exposure * linear[2]},
                    picture_.tone);
  }

  /// The tone curve is nearly straight over so small a range: it is applied to the mean.
  [[nodiscard]] Sum add_alike(std::span<const Painter::Sample> samples) const {
    Sum sum{{}, {}, static_cast<std::uint32_t>(samples.size())};
    for (const auto& s : samples) {
      for (std::size_t c = 0; c < 3; ++c) sum.linear[c] += static_cast<double>(s.radiosity[c]);
    }
    const double n = sum.count;
    sum.display = shown({sum.linear[0] / n, sum.linear[1] / n, sum.linear[2] / n});
    for (double& c : sum.display) c *= n;
    return sum;
  }

  [[nodiscard]] Sum add(std::span<const Painter::Sample> samples, Sum sum) const {
    for (const auto& s : samples) {
      const Rgb linear{static_cast<double>(s.radiosity[0]), static_cast<double>(s.radiosity[1]),
                       static_cast<double>(s.radiosity[2])};
      const Rgb display = shown(linear);
      for (std::size_t c = 0; c < 3; ++c) sum.linear[c] += linear[c], sum.display[c] += display[c];
      ++sum.count;
    }
    return sum;
  }

  void put(std::uint32_t x, std::uint32_t y, const Sum& sum) const {
    const std::size_t at = std::size_t{3} * (std::size_t{y} * picture_.width + x);
    for (std::size_t c = 0; c < 3; ++c) {
      picture_.pixels[at + c] = static_cast<float>(sum.linear[c] / sum.count);
      picture_.display[at + c] = static_cast<float>(sum.display[c] / sum.count);
    }
  }

  const Painter& painter_;
  const Lens& lens_;
  std::vector<Vec2> points_;
  Picture& picture_;
  std::size_t first_ = 0;  ///< so many samples of each pixel are taken before it is known whether it needs all
};

double aspect_of(const PictureOptions& options) {
  return static_cast<double>(options.width) / options.height;
}

/// What surfaces that are not lamps show on a coarse grid.
void coarse_view(const Painter& painter, const Lens& lens, std::vector<Brightness>& values) {
  constexpr std::uint32_t across = 160, down = 90;
  std::vector<Vec3> directions;
  for (std::uint32_t y = 0; y < down; ++y) {
    for (std::uint32_t x = 0; x < across; ++x) {
      directions.push_back(lens.direction((x + 0.5) / across, (y + 0.5) / down));
    }
  }
  std::vector<Painter::Sample> samples(directions.size());
  painter.look(lens.eye(), directions, samples);
  for (const auto& s : samples) {
    if (s.patch == Painter::nothing || painter.lamp(s.patch)) continue;
    values.push_back({brightness({static_cast<double>(s.radiosity[0]), static_cast<double>(s.radiosity[1]),
                                  static_cast<double>(s.radiosity[2])}),
                      1});
  }
}

}  // namespace

Renderer::Renderer(const Solution& solution, bool walls) {
  check_solution(solution);
  SmoothMesh smooth = smooth_mesh(*solution.mesh, smooth_crease, walls);
  const std::vector<Rgb> value = smooth_radiosities(smooth, *solution.mesh, solution.radiosity);
  painter_ = std::make_unique<Painter>(*solution.mesh, std::move(smooth), value);
}

Renderer::Renderer(const LitMesh& lit) : painter_(std::make_unique<Painter>(lit.mesh, lit.smooth, lit.radiosity)) {}

Renderer::~Renderer() = default;

Camera Renderer::camera(const PictureOptions& options) const {
  check_options(options);
  return options.camera ? *options.camera : frame_scene(painter_->mesh(), aspect_of(options));
}

double Renderer::exposure(const PictureOptions& options, std::span<const Camera> cameras) const {
  std::vector<Brightness> values;
  for (const Camera& camera : cameras) coarse_view(*painter_, Lens(camera, aspect_of(options)), values);
  return automatic_exposure(std::move(values), options.tone);
}

Picture Renderer::render(const PictureOptions& options, ProgressSink* progress) const {
  const Camera eye = camera(options);
  const Lens lens(eye, aspect_of(options));
  Picture picture;
  picture.width = options.width;
  picture.height = options.height;
  picture.tone = options.tone;
  picture.exposure = options.exposure ? *options.exposure : exposure(options, std::span(&eye, 1));
  picture.pixels.resize(std::size_t{3} * options.width * options.height);
  picture.display.resize(picture.pixels.size());
  const Canvas canvas(*painter_, lens, options, picture);
  if (progress != nullptr) progress->begin("Picture", options.height);
#pragma omp parallel
  {
    Canvas::Bench bench;
#pragma omp for schedule(dynamic, 1)
    for (std::uint32_t top = 0; top < options.height; top += Canvas::tile) {
      for (std::uint32_t left = 0; left < options.width; left += Canvas::tile) canvas.paint(left, top, bench);
      if (progress != nullptr) progress->advance(std::min(Canvas::tile, options.height - top));
    }
  }
  if (progress != nullptr) progress->end();
  return picture;
}

Picture render(const Solution& solution, const PictureOptions& options, ProgressSink* progress) {
  check_solution(solution);
  check_options(options);
  return Renderer(solution).render(options, progress);
}

}  // namespace interflect
