#include "interflect/formfactor/pair_tile.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace interflect {

using kernel::Polygon;
using sampling::Facet;
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
      lift_(static_cast<float>(lift_of_extent * patches.extent)),
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
  load_facets();
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
  Shaft shaft(boxes_[rows], boxes_[columns], 2 * static_cast<double>(lift_));
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

void PairTile::load_facets() {
  for (std::size_t k = 0; k < block; ++k) {
    const std::size_t i = first_row_ + k, j = first_column_ + k;
    row_word_[k] = sampling::word(seed_, static_cast<std::uint32_t>(i));
    column_word_[k] = sampling::word(seed_ + 1, static_cast<std::uint32_t>(j));
    if (i < patches_.size) row_facet_[k] = {whole(i), patches_.front(i)};
    if (j < patches_.size) column_facet_[k] = {whole(j), patches_.front(j)};
  }
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
    case PairKind::middle: s = kernel::quadrature(whole(i), whole(j), 6); break;
    case PairKind::near:
      s = kernel::contour(whole(i), whole(j));
      ++analytic_;
      break;
    case PairKind::straddle: {
      const Polygon a = part_in_front(i, j), b = part_in_front(j, i);
      s = a.size == 0 || b.size == 0 ? 0 : kernel::unoccluded(a, b, budget_.ratios);
      ++analytic_;
      break;
    }
  }
  ++considered_;
  if (!(s > negligible_factor * std::min(patches_.area[i], patches_.area[j]))) kind_[pair] = PairKind::none;
}

std::uint32_t PairTile::pilot_rays(float factor) const {
  const float rays = std::ceil(budget_.pilot_per_factor * factor);
  return static_cast<std::uint32_t>(std::clamp(rays, 1.0F, static_cast<float>(budget_.most_in_pilot)));
}

std::uint32_t PairTile::all_rays(float factor) const {
  return static_cast<std::uint32_t>(std::min(budget_.rays_per_factor * factor, static_cast<float>(budget_.most)));
}

void PairTile::trace_pilot() {
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    if (kind_[pair] == PairKind::none) continue;
    factor_[pair] =
        static_cast<float>(s_[pair] / std::min(patches_.area[row_patch(pair)], patches_.area[column_patch(pair)]));
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
    if (factor_[pair] >= budget_.split_from && kind_[pair] != PairKind::far) {
      trace_cut(pair);
      continue;
    }
    const std::uint32_t wanted = all_rays(factor_[pair]);
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
void PairTile::trace_cut(std::size_t pair) {
  const std::size_t i = row_patch(pair), j = column_patch(pair);
  const bool straddling = kind_[pair] == PairKind::straddle;
  CutPair cut{pair, slots_.size(), {}};
  const auto rays_of_pair = static_cast<float>(all_rays(factor_[pair])), s_of_pair = static_cast<float>(s_[pair]);
  for (const auto& x : quarters(straddling ? part_in_front(i, j) : whole(i))) {
    for (const auto& y : quarters(straddling ? part_in_front(j, i) : whole(j))) {
      const double s = kernel::unoccluded(Polygon(x), Polygon(y), budget_.ratios);
      cut.s.push_back(s);
      slots_.emplace_back();
      if (!(s > 0)) continue;
      const auto rays = static_cast<std::uint32_t>(rays_of_pair * (static_cast<float>(s) / s_of_pair));
      const Facet a(Polygon(x), patches_.front(i)), b(Polygon(y), patches_.front(j));
      add_rays(stream(a, b, pair, slots_.size() - 1, static_cast<std::uint32_t>(cut.s.size()), true), 0,
               std::max(rays, budget_.fewest_when_mixed));
    }
  }
  slots_[pair] = {};  // the pieces' rays replace the pair's own
  cut_.push_back(std::move(cut));
}

void PairTile::add_rays_of_pair(std::size_t pair, std::uint32_t first, std::uint32_t count) {
  const bool weighted = kind_[pair] != PairKind::far;
  if (kind_[pair] == PairKind::straddle) {
    const std::size_t i = row_patch(pair), j = column_patch(pair);
    const Facet a(part_in_front(i, j), patches_.front(i)), b(part_in_front(j, i), patches_.front(j));
    add_rays(stream(a, b, pair, pair, 0, weighted), first, count);
  } else {
    add_rays(stream(row_facet_[pair / block], column_facet_[pair % block], pair, pair, 0, weighted), first, count);
  }
}

PairTile::Stream PairTile::stream(const Facet& a, const Facet& b, std::size_t pair, std::size_t slot,
                                  std::uint32_t piece, bool weighted) const {
  return {a,
          b,
          sampling::start(row_word_[pair / block], static_cast<std::uint32_t>(column_patch(pair)), piece),
          sampling::start(column_word_[pair % block], static_cast<std::uint32_t>(row_patch(pair)), piece),
          slot,
          weighted};
}

/// Rays number first .. first + count − 1.
void PairTile::add_rays(const Stream& stream, std::uint32_t first, std::uint32_t count) {
  for (std::uint32_t k = first; k < first + count; ++k) {
    const sampling::ShadowRay ray = sampling::shadow_ray(stream.a, stream.b, stream.from, stream.to, k, lift_);
    if (!(ray.weight > 0)) continue;
    const auto [o, d] = std::pair(ray.origin, ray.direction);
    pending_.push_back({{o.x, o.y, o.z}, 0, {d.x, d.y, d.z}, 1});
    pending_slot_.emplace_back(static_cast<std::uint32_t>(stream.slot), stream.weighted ? ray.weight : 1);
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
