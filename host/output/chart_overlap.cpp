#include <algorithm>
#include <limits>
#include <numeric>

#include "interflect/output/charts.h"

namespace interflect {

namespace {

struct Interval {
  double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();
  void include(double x) { low = std::min(low, x), high = std::max(high, x); }
};

/// Whether a line along one of a's edges parts the triangles, but for `slack`.
bool parted_by_an_edge(const Triangle2& a, const Triangle2& b, double slack) {
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec2 p = a[k], q = a[(k + 1) % 3];
    const Vec2 across{p.y - q.y, q.x - p.x};
    const double size = std::hypot(across.x, across.y);
    if (!(size > 0)) continue;
    Interval of_a, of_b;
    for (const Vec2 c : a) of_a.include((c.x * across.x + c.y * across.y) / size);
    for (const Vec2 c : b) of_b.include((c.x * across.x + c.y * across.y) / size);
    if (of_a.high - of_b.low <= slack || of_b.high - of_a.low <= slack) return true;
  }
  return false;
}

struct Box {
  Interval x, y;
};

Box box_of(const Triangle2& triangle) {
  Box box;
  for (const Vec2 c : triangle) box.x.include(c.x), box.y.include(c.y);
  return box;
}

/// Per triangle: those of smaller index that overlap it. Sweeps along x.
std::vector<std::vector<std::uint32_t>> earlier_overlaps(const std::vector<Triangle2>& triangles, double slack) {
  std::vector<Box> boxes(triangles.size());
  std::transform(triangles.begin(), triangles.end(), boxes.begin(), box_of);
  std::vector<std::uint32_t> order(triangles.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(boxes[a].x.low, a) < std::pair(boxes[b].x.low, b);
  });
  std::vector<std::vector<std::uint32_t>> earlier(triangles.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Box& here = boxes[order[k]];
    for (std::size_t l = k + 1; l < order.size() && boxes[order[l]].x.low < here.x.high - slack; ++l) {
      const Box& there = boxes[order[l]];
      if (there.y.low >= here.y.high - slack || here.y.low >= there.y.high - slack) continue;
      if (!overlap(triangles[order[k]], triangles[order[l]], slack)) continue;
      earlier[std::max(order[k], order[l])].push_back(std::min(order[k], order[l]));
    }
  }
  return earlier;
}

}  // namespace

bool overlap(const Triangle2& a, const Triangle2& b, double slack) {
  return !parted_by_an_edge(a, b, slack) && !parted_by_an_edge(b, a, slack);
}

std::vector<std::uint32_t> layers_without_overlap(const std::vector<Triangle2>& triangles, double slack) {
  const auto earlier = earlier_overlaps(triangles, slack);
  std::vector<std::uint32_t> layer(triangles.size(), 0);
  std::vector<bool> taken;
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    taken.assign(earlier[t].size() + 1, false);
    for (const std::uint32_t other : earlier[t]) {
      if (layer[other] < taken.size()) taken[layer[other]] = true;
    }
    layer[t] = static_cast<std::uint32_t>(std::find(taken.begin(), taken.end(), false) - taken.begin());
  }
  return layer;
}

}  // namespace interflect
