#include "interflect/scene/texture.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace interflect {

namespace {

constexpr int most_samples_per_edge = 64;

std::size_t texel(double coordinate, std::uint32_t size) {
  const double wrapped = coordinate - std::floor(coordinate);
  if (!(wrapped > 0)) return 0;  // also for coordinates that are not finite
  return std::min<std::size_t>(static_cast<std::size_t>(wrapped * size), size - 1);
}

int samples_per_edge(const Image& image, const std::array<Vec2, 3>& uv) {
  double longest = 0;  // in texels
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec2 d = uv[(k + 1) % 3] + uv[k] * -1.0;
    longest = std::max(longest, std::hypot(d.x * image.width, d.y * image.height));
  }
  const double wanted = std::ceil(2 * longest);
  return wanted < most_samples_per_edge ? std::max(1, static_cast<int>(wanted)) : most_samples_per_edge;
}

}  // namespace

Rgb mean_over(const Image& image, const std::array<Vec2, 3>& uv) {
  const std::size_t texels = std::size_t{image.width} * image.height;
  if (texels == 0 || image.pixels.size() / 3 < texels) return {1, 1, 1};
  const int n = samples_per_edge(image, uv);
  Rgb sum{};
  const auto sample = [&](double s, double t) {  // s, t: shares of corners 1 and 2
    const Vec2 p = uv[0] * (1 - s - t) + uv[1] * s + uv[2] * t;
    const float* pixel = image.pixels.data() + 3 * (texel(p.y, image.height) * image.width + texel(p.x, image.width));
    for (std::size_t c = 0; c < 3; ++c) sum[c] += static_cast<double>(pixel[c]);
  };
  // The centroids of the n (n + 1) / 2 upright and the n (n - 1) / 2 inverted triangles of the grid.
  for (int i = 0; i < n; ++i) {
    for (int j = 0; i + j < n; ++j) {
      sample((i + 1.0 / 3) / n, (j + 1.0 / 3) / n);
      if (i + j < n - 1) sample((i + 2.0 / 3) / n, (j + 2.0 / 3) / n);
    }
  }
  for (double& channel : sum) channel /= double(n) * n;
  return sum;
}

}  // namespace interflect
