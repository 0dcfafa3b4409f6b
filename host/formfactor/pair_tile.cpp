#include "interflect/formfactor/pair_tile.h"

#include <algorithm>
#include <limits>

namespace interflect {

using kernel::Polygon;
using sampling::Facet;
using simd::PairKind;

namespace {

constexpr std::size_t pairs = PairTile::block * PairTile::block;

// Of the scene's extent: about 30 times what rounding a coordinate to single precision moves it.
constexpr double lift_of_extent = 2e-6;

// A factor below this is as good as none; it spares the rays of pairs that see each other at the very edge.
constexpr double negligible_factor = 1e-12;

}  // namespace

PairTile::PairTile(const PatchTable& patches, const Blockers& blockers, std::uint64_t seed, const RayBudget& budget)
    : patches_(patches),
      blockers_(blockers),
      seed_(seed),
      budget_(budget),
      lift_(static_cast<float>(lift_of_extent * patches.extent)),
      s_(pairs),
      kind_(pairs),
      factor_(pairs),
      pilot_(pairs),
      hidden_(pairs),
      parts_of_(pairs),
      slots_(pairs) {
  there_.reserve(pairs);
  for (std::size_t b = 0; b < patches.blocks(); ++b) {
    const std::size_t first = b * block, end = std::min(first + block, patches.size);
    Box box{patches.triangle(first)[0], patches.triangle(first)[0]};
    for (std::size_t i = first; i < end; ++i) {
      for (const Vec3 p : patches.triangle(i)) box = {min(box.low, p), max(box.high, p)};
    }
    boxes_.push_back(box);
  }
}

bool PairTile::compute(std::size_t rows, std::size_t columns) {
  first_row_ = rows * block;
  first_column_ = columns * block;
  std::fill(s_.begin(), s_.end(), 0.0);
  std::fill(kind_.begin(), kind_.end(), PairKind::none);
  there_.clear();
  parts_.clear();
  for (std::size_t k = 0; k < block; ++k) row_points_[k].size = column_points_[k].size = 0;
  variance_ = 0;
  find_kinds(rows, columns);
  if (there_.empty()) return false;
  add_quadrature_variance();
  if (!anything_between(rows, columns)) return true;
  slots_.assign(pairs, {});
  cut_.clear();
  load_facets();
  find_factors();
  trace_pilot();
  if (trace_mixed()) add_ray_variance();
  hide();
  return true;
}

/// S times the visible share.
void PairTile::hide() {
  for (const std::size_t pair : there_) s_[pair] *= static_cast<double>(1 - slots_[pair].hidden_share());
  for (const CutPair& cut : cut_) {
    double sum = 0, visible = 0;
    for (std::size_t k = 0; k < cut.s.size(); ++k) {
      sum += cut.s[k];
      visible += cut.s[k] * static_cast<double>(1 - slots_[cut.first + k].hidden_share());
    }
    if (sum > 0) s_[cut.pair] *= visible / sum;
  }
}

/// Whether anything can hide one of the tile's pairs.
bool PairTile::anything_between(std::size_t rows, std::size_t columns) {
  Shaft shaft(boxes_[rows], boxes_[columns], 2 * static_cast<double>(lift_));
  shaft.behind = std::numeric_limits<double>::infinity();
  std::array<bool, block> row_takes_part{}, column_takes_part{};
  for (const std::size_t pair : there_) row_takes_part[pair / block] = column_takes_part[pair % block] = true;
  const auto add = [&](std::vector<kernel::Plane>& planes, std::size_t i) {
    const kernel::Plane plane = patches_.plane(i);
    shaft.behind = std::min(shaft.behind, patches_.tolerance[i]);
    if (planes.empty() || !(planes.back().normal == plane.normal) || planes.back().offset != plane.offset) {
      planes.push_back(plane);
    }
  };
  for (std::size_t k = 0; k < block; ++k) {
    if (row_takes_part[k]) add(shaft.from, first_row_ + k);
    if (column_takes_part[k]) add(shaft.to, first_column_ + k);
  }
  return blockers_.any_in(shaft, hint_);
}

/// Leaves S unoccluded in s_, and none in kind_ where it is 0.
void PairTile::find_kinds(std::size_t rows, std::size_t columns) {
  const auto may_see = [&](std::size_t i, const Box& box) {
    const Vec3 n = patches_.front(i);
    const Vec3 farthest{n.x > 0 ? box.high.x : box.low.x, n.y > 0 ? box.high.y : box.low.y,
                        n.z > 0 ? box.high.z : box.low.z};
    return dot(n, farthest) - patches_.offset[i] > patches_.tolerance[i];
  };
  std::array<bool, block> column_sees{};
  bool any = false;
  for (std::size_t b = 0; b < block && first_column_ + b < patches_.size; ++b) {
    column_sees[b] = may_see(first_column_ + b, boxes_[rows]);
    any = any || column_sees[b];
  }
  if (!any) return;
  for (std::size_t a = 0; a < block && first_row_ + a < patches_.size; ++a) {
    const std::size_t i = first_row_ + a;
    if (!may_see(i, boxes_[columns])) continue;
    const auto kinds = std::span(kind_).subspan(a * block).first<block>();
    simd::classify(patches_, budget_.ratios, i, first_column_, kinds, std::span(s_).subspan(a * block).first<block>());
    for (std::size_t b = 0; b < block; ++b) {
      const std::size_t pair = a * block + b;
      if (!column_sees[b] || first_column_ + b <= i) kind_[pair] = PairKind::none;
      if (kind_[pair] != PairKind::none) finish_kind(pair);
      if (kind_[pair] == PairKind::none) {
        s_[pair] = 0;
      } else {
        there_.push_back(static_cast<std::uint16_t>(pair));
      }
    }
  }
}

const kernel::Samples& PairTile::six_points(kernel::Samples& kept, std::size_t patch) const {
  if (kept.size == 0) kept = kernel::samples(whole(patch), 6);
  return kept;
}

void PairTile::finish_kind(std::size_t pair) {
  const std::size_t i = row_patch(pair), j = column_patch(pair);
  double& s = s_[pair];
  switch (kind_[pair]) {
    case PairKind::none: return;
    case PairKind::far: break;
    case PairKind::middle:
      s = kernel::quadrature(six_points(row_points_[pair / block], i), six_points(column_points_[pair % block], j));
      break;
    case PairKind::near:
      s = kernel::contour(whole(i), whole(j));
      ++analytic_;
      break;
    case PairKind::straddle: {
      const Polygon a = part_in_front(i, j), b = part_in_front(j, i);
      s = a.size == 0 || b.size == 0 ? 0 : kernel::unoccluded(a, b, budget_.ratios);
      parts_of_[pair] = static_cast<std::uint16_t>(parts_.size());
      parts_.push_back({Facet(a, patches_.front(i)), Facet(b, patches_.front(j))});
      ++analytic_;
      break;
    }
  }
  ++considered_;
  if (!(s > negligible_factor * std::min(patches_.area[i], patches_.area[j]))) kind_[pair] = PairKind::none;
}

}  // namespace interflect
