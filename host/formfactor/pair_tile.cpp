#include "interflect/formfactor/pair_tile.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "interflect/formfactor/sampling.h"

namespace interflect {

using kernel::Polygon;
using simd::PairKind;

namespace {

constexpr std::size_t pairs = PairTile::block * PairTile::block;
constexpr std::size_t batch = 4096;  // rays traced at a time

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
      lift_(lift_of_extent * patches.extent),
      s_(pairs),
      kind_(pairs),
      factor_(pairs),
      pilot_(pairs),
      hidden_(pairs),
      slots_(pairs),
      occluded_(std::make_unique<bool[]>(batch)) {
  pending_.reserve(batch);
  pending_slot_.reserve(batch);
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
  find_kinds(rows, columns);
  if (std::all_of(kind_.begin(), kind_.end(), [](PairKind k) { return k == PairKind::none; })) return false;
  if (!anything_between(rows, columns)) return true;
  slots_.assign(pairs, {});
  cut_.clear();
  load_shapes();
  trace_pilot();
  trace_mixed();
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    if (kind_[pair] != PairKind::none) s_[pair] *= 1 - hidden_share(pair);
  }
  for (const CutPair& cut : cut_) {
    double sum = 0, visible = 0;
    for (std::size_t k = 0; k < cut.s.size(); ++k) {
      sum += cut.s[k];
      visible += cut.s[k] * (1 - hidden_share(cut.first + k));
    }
    if (sum > 0) s_[cut.pair] *= visible / sum;
  }
  return true;
}

/// Whether anything can hide one of the tile's pairs.
bool PairTile::anything_between(std::size_t rows, std::size_t columns) {
  Shaft shaft(boxes_[rows], boxes_[columns], 2 * lift_);
  shaft.behind = std::numeric_limits<double>::infinity();
  std::array<bool, block> row_takes_part{}, column_takes_part{};
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    if (kind_[pair] != PairKind::none) row_takes_part[pair / block] = column_takes_part[pair % block] = true;
  }
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

void PairTile::load_shapes() {
  for (std::size_t k = 0; k < block; ++k) {
    row_hash_[k] = sampling::hash(seed_, static_cast<std::uint32_t>(first_row_ + k));
    column_hash_[k] = sampling::hash(seed_ + 1, static_cast<std::uint32_t>(first_column_ + k));
    if (first_row_ + k < patches_.size) row_shape_[k] = whole(first_row_ + k);
    if (first_column_ + k < patches_.size) column_shape_[k] = whole(first_column_ + k);
  }
}

PairTile::Shape PairTile::whole(std::size_t patch) const {
  return {Polygon(patches_.triangle(patch)), 1, patches_.front(patch)};
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
    simd::classify(patches_, i, first_column_, kinds, std::span(s_).subspan(a * block).first<block>());
    for (std::size_t b = 0; b < block; ++b) {
      const std::size_t pair = a * block + b;
      if (!column_sees[b] || first_column_ + b <= i) kind_[pair] = PairKind::none;
      if (kind_[pair] != PairKind::none) finish_kind(pair, i, first_column_ + b);
      if (kind_[pair] == PairKind::none) s_[pair] = 0;
    }
  }
}

void PairTile::finish_kind(std::size_t pair, std::size_t i, std::size_t j) {
  double& s = s_[pair];
  switch (kind_[pair]) {
    case PairKind::none: return;
    case PairKind::far: break;
    case PairKind::middle:
      s = kernel::quadrature(Polygon(patches_.triangle(i)), Polygon(patches_.triangle(j)), 6);
      break;
    case PairKind::near:
      s = kernel::contour(Polygon(patches_.triangle(i)), Polygon(patches_.triangle(j)));
      ++analytic_;
      break;
    case PairKind::straddle: {
      const Polygon a = part_in_front(i, j).polygon, b = part_in_front(j, i).polygon;
      s = a.size == 0 || b.size == 0 ? 0 : kernel::unoccluded(a, b);
      ++analytic_;
      break;
    }
  }
  ++considered_;
  if (!(s > negligible_factor * std::min(patches_.area[i], patches_.area[j]))) kind_[pair] = PairKind::none;
}

PairTile::Shape PairTile::part_in_front(std::size_t patch, std::size_t other) const {
  Shape out{kernel::clip(patches_.triangle(patch), patches_.plane(other)), 1, patches_.front(patch)};
  if (out.polygon.size == 4) {
    const double first = kernel::area(Polygon(out.polygon.fan(0))), second = kernel::area(Polygon(out.polygon.fan(1)));
    out.share_of_first = first + second > 0 ? first / (first + second) : 1;
  }
  return out;
}

std::uint32_t PairTile::pilot_rays(double factor) const {
  if (budget_.pilot_per_factor * factor <= 1) return 1;
  return static_cast<std::uint32_t>(std::clamp(std::ceil(budget_.pilot_per_factor * factor), 1.0, 64.0));
}

void PairTile::trace_pilot() {
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    if (kind_[pair] == PairKind::none) continue;
    factor_[pair] = s_[pair] / std::min(patches_.area[row_patch(pair)], patches_.area[column_patch(pair)]);
    pilot_[pair] = pilot_rays(factor_[pair]);
    add_rays_of_pair(pair, 0, pilot_[pair]);
  }
  flush();
}

/// Whether the pair deserves more rays. With few rays of its own only the neighbours are asked: a decision that looked
/// at the pair's own rays would be biased towards what most of them say.
bool PairTile::disagrees(std::size_t pair) const {
  const double own = hidden_[pair];
  const std::uint32_t rays = pilot_[pair];
  if (rays >= 8 && own > 0 && own < 1) return true;
  const auto a = static_cast<std::ptrdiff_t>(pair / block), b = static_cast<std::ptrdiff_t>(pair % block);
  double low = 1, high = 0;
  if (rays >= 8) low = high = own;
  for (std::ptrdiff_t x = std::max<std::ptrdiff_t>(a - 1, 0); x <= std::min<std::ptrdiff_t>(a + 1, block - 1); ++x) {
    for (std::ptrdiff_t y = std::max<std::ptrdiff_t>(b - 1, 0); y <= std::min<std::ptrdiff_t>(b + 1, block - 1); ++y) {
      const auto other = static_cast<std::size_t>(x) * block + static_cast<std::size_t>(y);
      if (other == pair || kind_[other] == PairKind::none) continue;
      const double hidden = hidden_[other];
      low = std::min(low, hidden);
      high = std::max(high, hidden);
    }
  }
  return high > low;
}

void PairTile::trace_mixed() {
  double low = 1, high = 0;
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    if (kind_[pair] == PairKind::none) continue;
    hidden_[pair] = hidden_share(pair);
    low = std::min(low, hidden_[pair]);
    high = std::max(high, hidden_[pair]);
  }
  if (low == high && (low == 0 || low == 1)) return;  // all free or all hidden: nobody disagrees
  std::array<bool, pairs> mixed{};
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    mixed[pair] = kind_[pair] != PairKind::none && disagrees(pair);
  }
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    if (!mixed[pair]) continue;
    const double f = factor_[pair];
    if (f >= budget_.split_from && kind_[pair] != PairKind::far) {
      trace_cut(pair, f);
      continue;
    }
    const auto wanted = static_cast<std::uint32_t>(std::min<double>(budget_.rays_per_factor * f, budget_.most));
    const std::uint32_t have = pilot_[pair], all = std::max(wanted, budget_.fewest_when_mixed);
    if (all <= have) continue;
    add_rays_of_pair(pair, have, all - have);
  }
  flush();
}

namespace {

/// The fan's triangles, each cut at its edge midpoints into four.
std::vector<std::array<Vec3, 3>> quarters(const Polygon& polygon) {
  std::vector<std::array<Vec3, 3>> out;
  for (std::size_t k = 0; k + 2 < polygon.size; ++k) {
    const auto t = polygon.fan(k);
    const Vec3 ab = 0.5 * (t[0] + t[1]), bc = 0.5 * (t[1] + t[2]), ca = 0.5 * (t[2] + t[0]);
    out.insert(out.end(), {{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}});
  }
  return out;
}

}  // namespace

/// Both patches in quarters: exact S of the pieces with rays of their own, so that the kernel's peaks (near a common
/// edge) do not meet the coarse sampling of V.
void PairTile::trace_cut(std::size_t pair, double factor) {
  const std::size_t i = row_patch(pair), j = column_patch(pair);
  const bool straddling = kind_[pair] == PairKind::straddle;
  const Shape a = straddling ? part_in_front(i, j) : whole(i), b = straddling ? part_in_front(j, i) : whole(j);
  CutPair cut{pair, slots_.size(), {}};
  const double all_rays = std::min<double>(budget_.rays_per_factor * factor, budget_.most);
  for (const auto& x : quarters(a.polygon)) {
    for (const auto& y : quarters(b.polygon)) {
      const double s = kernel::unoccluded(Polygon(x), Polygon(y));
      cut.s.push_back(s);
      const std::size_t slot = slots_.size();
      slots_.emplace_back();
      const auto rays = static_cast<std::uint32_t>(std::max(4.0, all_rays * s / s_[pair]));
      if (s > 0) add_rays({Polygon(x), 1, a.normal}, {Polygon(y), 1, b.normal}, pair, slot, 0, rays, true);
    }
  }
  slots_[pair] = {};  // the pieces' rays replace the pair's own
  cut_.push_back(std::move(cut));
}

void PairTile::add_rays_of_pair(std::size_t pair, std::uint32_t first, std::uint32_t count) {
  const bool weighted = kind_[pair] != PairKind::far;
  if (kind_[pair] == PairKind::straddle) {
    const std::size_t i = row_patch(pair), j = column_patch(pair);
    add_rays(part_in_front(i, j), part_in_front(j, i), pair, pair, first, count, weighted);
  } else {
    add_rays(row_shape_[pair / block], column_shape_[pair % block], pair, pair, first, count, weighted);
  }
}

/// Rays number first .. first + count − 1 of a pair, or of a piece of it.
void PairTile::add_rays(const Shape& a, const Shape& b, std::size_t pair, std::size_t slot, std::uint32_t first,
                        std::uint32_t count, bool weighted) {
  const auto i = static_cast<std::uint32_t>(row_patch(pair)), j = static_cast<std::uint32_t>(column_patch(pair));
  const std::uint64_t piece = slot < pairs ? 0 : slot - pairs + 1;
  const auto from = sampling::rotated(piece == 0 ? row_hash_[pair / block] : sampling::hash(seed_ + 2 * piece, i), j);
  const auto to =
      sampling::rotated(piece == 0 ? column_hash_[pair % block] : sampling::hash(seed_ + 2 * piece + 1, j), i);
  for (std::uint32_t k = first; k < first + count; ++k) {
    const Vec3 x = sampling::on_polygon(a.polygon, {from.u + k * sampling::step4[0], from.v + k * sampling::step4[1]},
                                        a.share_of_first);
    const Vec3 y = sampling::on_polygon(b.polygon, {to.u + k * sampling::step4[2], to.v + k * sampling::step4[3]},
                                        b.share_of_first);
    const Vec3 between = y - x;
    const double above_a = dot(a.normal, between), above_b = -dot(b.normal, between);
    if (!(above_a > 0 && above_b > 0)) continue;  // on the other's plane, to rounding: no weight
    const Vec3 start = x + std::min(lift_, 0.25 * above_a) * a.normal;
    const Vec3 direction = y + std::min(lift_, 0.25 * above_b) * b.normal - start;
    double weight = 1;
    if (weighted) {
      const double r2 = dot(between, between);
      weight = above_a * above_b / (r2 * r2);
    }
    pending_.push_back(
        {{static_cast<float>(start.x), static_cast<float>(start.y), static_cast<float>(start.z)},
         0,
         {static_cast<float>(direction.x), static_cast<float>(direction.y), static_cast<float>(direction.z)},
         1});
    pending_slot_.emplace_back(static_cast<std::uint32_t>(slot), static_cast<float>(weight));
    if (pending_.size() == batch) flush();
  }
}

void PairTile::flush() {
  blockers_.visibility().occluded(pending_, {occluded_.get(), pending_.size()});
  rays_ += pending_.size();
  for (std::size_t k = 0; k < pending_.size(); ++k) {
    const auto [slot, weight] = pending_slot_[k];
    slots_[slot].total += weight;
    if (occluded_[k]) slots_[slot].hidden += weight;
  }
  pending_.clear();
  pending_slot_.clear();
}

}  // namespace interflect
