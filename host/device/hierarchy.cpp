#include "interflect/device/hierarchy.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

#include "interflect/base/error.h"
#include "interflect/device/kernel_table.h"

namespace interflect {

namespace {

constexpr std::size_t children = 4, in_leaf = 4, bins = 16;
using Point = std::array<float, 3>;

struct Bounds {
  Point low, high;
  Bounds() {
    low.fill(std::numeric_limits<float>::infinity());
    high.fill(-std::numeric_limits<float>::infinity());
  }
  void add(const Point& p) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  void add(const Bounds& b) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], b.low[k]);
      high[k] = std::max(high[k], b.high[k]);
    }
  }
  [[nodiscard]] double extent(std::size_t axis) const {
    return static_cast<double>(high[axis]) - static_cast<double>(low[axis]);
  }
  /// Half the surface; 0 of nothing.
  [[nodiscard]] double area() const {
    if (low[0] > high[0]) return 0;
    return extent(0) * extent(1) + extent(1) * extent(2) + extent(2) * extent(0);
  }
};

/// Leaves that n triangles fill.
double leaves_of(std::size_t n) {
  return static_cast<double>((n + in_leaf - 1) / in_leaf);
}

}  // namespace

class Hierarchy::Builder {
 public:
  Builder(Hierarchy& out, std::span<const Vec3> vertices, std::span<const std::array<std::uint32_t, 3>> triangles);
  void build();

 private:
  /// Triangles order_[first, end).
  struct Range {
    std::size_t first = 0, end = 0;
    Bounds box;
    [[nodiscard]] std::size_t size() const { return end - first; }
  };
  [[nodiscard]] Range range(std::size_t first, std::size_t end) const;
  [[nodiscard]] std::size_t by_area(const Range& r);
  [[nodiscard]] std::size_t by_number(const Range& r);
  [[nodiscard]] std::vector<Range> parts_of(const Range& whole, std::uint32_t level);
  std::uint32_t node(const Range& whole, std::uint32_t level);
  std::uint32_t leaf(const Range& r);
  void write_boxes(std::uint32_t number, const Bounds& box, std::span<const Range> parts);

  Hierarchy& out_;
  std::vector<std::array<Point, 3>> triangles_;
  std::vector<Bounds> boxes_;
  std::vector<Point> middles_;  ///< of the boxes, doubled
  std::vector<std::uint32_t> order_;
  float largest_ = 0;  ///< coordinate
};

Hierarchy::Builder::Builder(Hierarchy& out, std::span<const Vec3> vertices,
                            std::span<const std::array<std::uint32_t, 3>> triangles)
    : out_(out), order_(triangles.size()) {
  for (const auto& t : triangles) {
    std::array<Point, 3>& corners = triangles_.emplace_back();
    Bounds box;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 p = vertices[t[k]];
      corners[k] = {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
      box.add(corners[k]);
    }
    boxes_.push_back(box);
    largest_ = std::max({largest_, -box.low[0], -box.low[1], -box.low[2], box.high[0], box.high[1], box.high[2]});
    middles_.push_back({box.low[0] + box.high[0], box.low[1] + box.high[1], box.low[2] + box.high[2]});
  }
  std::iota(order_.begin(), order_.end(), 0U);
}

void Hierarchy::Builder::build() {
  if (order_.empty()) {
    out_.leaves_.assign(leaf_floats, 0.0F);
    out_.nodes_.assign(node_words, 0U);
    std::fill_n(out_.nodes_.begin() + 4, 3, ~0U);
    std::fill_n(out_.nodes_.begin() + 12, 4, leaf_bit);
    out_.nodes_[3] = 0x01010101U;
    out_.levels_ = 1;
    return;
  }
  node(range(0, order_.size()), 1);
}

Hierarchy::Builder::Range Hierarchy::Builder::range(std::size_t first, std::size_t end) const {
  Range r{first, end, {}};
  for (std::size_t k = first; k < end; ++k) r.box.add(boxes_[order_[k]]);
  return r;
}

/// Halves by number along the longest axis of the middles. Ties go by number, so that the result is the input's alone.
std::size_t Hierarchy::Builder::by_number(const Range& r) {
  Bounds middles;
  for (std::size_t k = r.first; k < r.end; ++k) middles.add(middles_[order_[k]]);
  std::size_t axis = 0;
  for (const std::size_t other : {1U, 2U}) {
    if (middles.extent(other) > middles.extent(axis)) axis = other;
  }
  const std::size_t half = r.first + r.size() / 2;
  const auto at = [&](std::size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
  std::nth_element(at(r.first), at(half), at(r.end), [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(middles_[a][axis], a) < std::pair(middles_[b][axis], b);
  });
  std::sort(at(r.first), at(half));
  std::sort(at(half), at(r.end));
  return half;
}

/// Cuts where area times leaves of both sides is least, among planes between bins of the triangles' middles.
std::size_t Hierarchy::Builder::by_area(const Range& r) {
  Bounds middles;
  for (std::size_t k = r.first; k < r.end; ++k) middles.add(middles_[order_[k]]);
  struct Bin {
    Bounds box;
    std::size_t count = 0;
  };
  const auto bin_of = [&](std::uint32_t triangle, std::size_t axis) {
    const double at = (static_cast<double>(middles_[triangle][axis]) - static_cast<double>(middles.low[axis])) /
                      middles.extent(axis) * static_cast<double>(bins);
    return std::min(static_cast<std::size_t>(at), bins - 1);
  };
  double least = std::numeric_limits<double>::infinity();
  std::size_t best_axis = 0, best_bin = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!(middles.extent(axis) > 0)) continue;
    std::array<Bin, bins> all;
    for (std::size_t k = r.first; k < r.end; ++k) {
      Bin& bin = all[bin_of(order_[k], axis)];
      bin.box.add(boxes_[order_[k]]);
      ++bin.count;
    }
    std::array<double, bins> above{};  // cost of the bins from k on
    Bin sum;
    for (std::size_t k = bins; k-- > 1;) {
      sum.box.add(all[k].box);
      sum.count += all[k].count;
      above[k] = sum.box.area() * leaves_of(sum.count);
    }
    sum = {};
    for (std::size_t k = 1; k < bins; ++k) {
      sum.box.add(all[k - 1].box);
      sum.count += all[k - 1].count;
      if (sum.count == 0 || sum.count == r.size()) continue;
      const double cost = sum.box.area() * leaves_of(sum.count) + above[k];
      if (cost < least) {
        least = cost;
        best_axis = axis;
        best_bin = k;
      }
    }
  }
  if (!std::isfinite(least)) return by_number(r);  // all middles are one
  const auto at = [&](std::size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
  const auto cut =
      std::stable_partition(at(r.first), at(r.end), [&](std::uint32_t t) { return bin_of(t, best_axis) < best_bin; });
  return static_cast<std::size_t>(cut - order_.begin());
}

/// Up to four parts; of those that are no leaf yet the largest surface is cut first.
std::vector<Hierarchy::Builder::Range> Hierarchy::Builder::parts_of(const Range& whole, std::uint32_t level) {
  // Levels that remain below take 4^k leaves; a part of any size fits them as long as the whole does.
  const bool tight = whole.size() > in_leaf << (2 * (most_levels - level));
  std::vector<Range> parts{whole};
  while (parts.size() < children) {
    auto chosen = parts.end();
    const auto rank = [&](const Range& r) { return std::pair(tight ? 0.0 : r.box.area(), r.size()); };
    for (auto p = parts.begin(); p != parts.end(); ++p) {
      if (p->size() > in_leaf && (chosen == parts.end() || rank(*p) > rank(*chosen))) chosen = p;
    }
    if (chosen == parts.end()) break;
    const Range part = *chosen;
    const std::size_t cut = tight ? by_number(part) : by_area(part);
    *chosen = range(part.first, cut);
    parts.insert(chosen + 1, range(cut, part.end));
  }
  return parts;
}

std::uint32_t Hierarchy::Builder::node(const Range& whole, std::uint32_t level) {
  const std::uint32_t number = out_.node_count();
  out_.levels_ = std::max(out_.levels_, level);
  out_.nodes_.resize(out_.nodes_.size() + node_words);
  std::vector<Range> parts = parts_of(whole, level);
  // A kernel takes the last one first: the largest is the likeliest to hide something.
  std::stable_sort(parts.begin(), parts.end(),
                   [](const Range& a, const Range& b) { return a.box.area() < b.box.area(); });
  write_boxes(number, whole.box, parts);
  for (std::size_t k = 0; k < children; ++k) {
    const std::size_t at = std::size_t{number} * node_words + 12 + k;
    const std::uint32_t child = k >= parts.size()            ? out_.nodes_[at - 1]
                                : parts[k].size() <= in_leaf ? leaf(parts[k])
                                                             : node(parts[k], level + 1);
    out_.nodes_[at] = child;
  }
  return number;
}

std::uint32_t Hierarchy::Builder::leaf(const Range& r) {
  const std::uint32_t number = out_.leaf_count();
  const std::size_t at = out_.leaves_.size();
  out_.leaves_.resize(at + leaf_floats);
  for (std::size_t k = 0; k < in_leaf; ++k) {
    const bool there = r.first + k < r.end;
    const auto& corners = triangles_[order_[there ? r.first + k : r.first]];
    for (std::size_t corner = 0; corner < 3; ++corner) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        out_.leaves_[at + (corner * 3 + axis) * in_leaf + k] = corners[there ? corner : 0][axis];
      }
    }
  }
  return number | leaf_bit;
}

/// The children's boxes on the grid of the node, outwards, larger by what the rounding of a kernel's test of a box can
/// amount to: at most 54 * 2^-24 of the largest coordinate where the ray starts within four times that, and here twice
/// as much. Differences of floats in double are rounded by 2^-53 of them at most.
void Hierarchy::Builder::write_boxes(std::uint32_t number, const Bounds& box, std::span<const Range> parts) {
  const double wider = 0x1p-17 * static_cast<double>(largest_);
  const std::span words = std::span(out_.nodes_).subspan(std::size_t{number} * node_words, node_words);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto corner =
        static_cast<float>(static_cast<double>(box.low[axis]) - 2 * wider);  // rounded by less than `wider`
    const double extent = static_cast<double>(box.high[axis]) + wider - static_cast<double>(corner);
    int exponent = -125;
    if (extent > 0) exponent = std::max(exponent, std::ilogb(extent / 255.0));
    while (std::ldexp(255.0, exponent) < extent) ++exponent;
    const double step = std::ldexp(1.0, exponent);
    const auto steps = [&](double side) { return (side - static_cast<double>(corner)) / step; };
    words[axis] = std::bit_cast<std::uint32_t>(corner);
    words[3] |= static_cast<std::uint32_t>(exponent + 127) << (8 * axis);
    for (std::size_t k = 0; k < children; ++k) {
      std::uint32_t low = 255, high = 0;
      if (k < parts.size()) {
        low = static_cast<std::uint32_t>(std::floor(steps(static_cast<double>(parts[k].box.low[axis]) - wider)));
        high = static_cast<std::uint32_t>(std::ceil(steps(static_cast<double>(parts[k].box.high[axis]) + wider)));
      }
      words[4 + axis] |= low << (8 * k);
      words[8 + axis] |= high << (8 * k);
    }
  }
}

Hierarchy::Hierarchy(std::span<const Vec3> vertices, std::span<const std::array<std::uint32_t, 3>> triangles) {
  if (triangles.size() > largest_hierarchy) {  // a leaf holds one at least
    throw Error(ErrorKind::limit,
                fmt::format("{} triangles, a hierarchy takes {} at most", triangles.size(), largest_hierarchy));
  }
  Builder(*this, vertices, triangles).build();
}

}  // namespace interflect
