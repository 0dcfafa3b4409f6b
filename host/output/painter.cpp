#include "interflect/output/painter.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "interflect/output/tone.h"

namespace interflect {

namespace {

constexpr double largest_value = 1e30;  // so that sums over samples stay finite floats

/// Per patch: the least smooth vertex that it is joined with over common smooth vertices.
std::vector<std::uint32_t> joined_surfaces(const SmoothMesh& smooth) {
  std::vector<std::uint32_t> parent(smooth.size());
  std::iota(parent.begin(), parent.end(), 0U);
  const auto find = [&](std::uint32_t s) {
    while (parent[s] != s) s = parent[s] = parent[parent[s]];
    return s;
  };
  for (const auto& c : smooth.corners) {
    for (const std::uint32_t other : {c[1], c[2]}) {
      const std::uint32_t a = find(c[0]), b = find(other);
      parent[std::max(a, b)] = std::min(a, b);
    }
  }
  std::vector<std::uint32_t> surface(smooth.corners.size());
  std::transform(smooth.corners.begin(), smooth.corners.end(), surface.begin(),
                 [&](const auto& c) { return find(c[0]); });
  return surface;
}

}  // namespace

Painter::Painter(const PatchMesh& mesh, SmoothMesh smooth, const std::vector<Rgb>& value)
    : mesh_(mesh), sight_(mesh), smooth_(std::move(smooth)), surface_(joined_surfaces(smooth_)), lamp_(mesh.size()) {
  value_.reserve(value.size());
  for (const Rgb& b : value) {
    auto& v = value_.emplace_back();
    // NaN falls to 0 as well.
    for (std::size_t c = 0; c < 3; ++c) v[c] = static_cast<float>(b[c] > 0 ? std::min(b[c], largest_value) : 0.0);
  }
  for (std::size_t i = 0; i < mesh.size(); ++i) lamp_[i] = emits(mesh.emittance[i]) ? 1 : 0;
}

Painter::Sample Painter::shade(const Sight::Seen& seen) const {
  if (!seen.front) return {};
  Sample sample{{}, seen.patch, surface_[seen.patch]};
  const auto& s = smooth_.corners[seen.patch];
  std::array<float, 3> weight{1 - seen.u - seen.v, seen.u, seen.v};
  if (const Cut* cut = smooth_.walls.cut(seen.patch)) {
    const auto shares =
        cut->shares({static_cast<double>(weight[0]), static_cast<double>(seen.u), static_cast<double>(seen.v)});
    for (std::size_t k = 0; k < 3; ++k) weight[k] = static_cast<float>(shares[k]);
  }
  // From one of them on, so that where all are equal the value is exactly theirs.
  const std::size_t base = weight[0] > 0 ? 0 : weight[1] > 0 ? 1 : 2, next = (base + 1) % 3, last = (base + 2) % 3;
  for (std::size_t c = 0; c < 3; ++c) {
    const float from = value_[s[base]][c];
    sample.radiosity[c] =
        from + weight[next] * (value_[s[next]][c] - from) + weight[last] * (value_[s[last]][c] - from);
  }
  return sample;
}

void Painter::look(Vec3 eye, std::span<const Vec3> directions, std::span<Sample> samples) const {
  constexpr std::size_t at_once = 256;
  std::array<Sight::Seen, at_once> seen;
  for (std::size_t first = 0; first < directions.size(); first += at_once) {
    const std::size_t count = std::min(at_once, directions.size() - first);
    sight_.fronts(eye, directions.subspan(first, count), std::span(seen).first(count));
    for (std::size_t k = 0; k < count; ++k) samples[first + k] = shade(seen[k]);
  }
}

}  // namespace interflect
