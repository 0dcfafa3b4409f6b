#include <algorithm>
#include <cmath>

#include "interflect/base/timer.h"
#include "interflect/formfactor/pair_tile.h"

// PairTile's shadow rays: how many each pair gets, and what they met.

namespace interflect {

using kernel::Polygon;
using sampling::Facet;
using simd::PairKind;

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

void PairTile::load_facets() {
  for (std::size_t k = 0; k < block; ++k) {
    const std::size_t i = first_row_ + k, j = first_column_ + k;
    row_word_[k] = sampling::word(seed_, static_cast<std::uint32_t>(i));
    column_word_[k] = sampling::word(seed_ + 1, static_cast<std::uint32_t>(j));
    if (i < patches_.size) row_facet_[k] = {whole(i), patches_.front(i)};
    if (j < patches_.size) column_facet_[k] = {whole(j), patches_.front(j)};
    columns_.set(k, column_facet_[k], column_word_[k]);
  }
}

std::uint32_t PairTile::pilot_rays(float factor) const {
  const float rays = std::min(budget_.pilot_per_factor * factor, static_cast<float>(budget_.most_in_pilot));
  const auto whole = static_cast<std::uint32_t>(rays);  // rounded up below; std::ceil is a call
  return std::max(1U, whole + (static_cast<float>(whole) < rays ? 1U : 0U));
}

std::uint32_t PairTile::all_rays(float factor) const {
  return static_cast<std::uint32_t>(std::min(budget_.rays_per_factor * factor, static_cast<float>(budget_.most)));
}

void PairTile::find_factors() {
  for (const std::size_t pair : there_) {
    const double smaller = std::min(patches_.area[row_patch(pair)], patches_.area[column_patch(pair)]);
    factor_[pair] = static_cast<float>(s_[pair] / smaller);
    pilot_[pair] = pilot_rays(factor_[pair]);
  }
}

/// Row by row: ray number 0 of all pairs in SIMD over the columns, then the others in SIMD over the rays.
void PairTile::trace_pilot() {
  for (std::size_t next = 0; next < there_.size();) {
    const std::size_t row = there_[next] / block, begin = next;
    std::array<FirstRay, block> wanted{};
    for (; next < there_.size() && there_[next] / block == row; ++next) {
      const std::size_t pair = there_[next];
      if (kind_[pair] != PairKind::straddle) {
        wanted[pair % block] = kind_[pair] == PairKind::far ? FirstRay::plain : FirstRay::weighted;
      }
    }
    if (pending_.room() < block) flush();
    simd::first_rays(row_facet_[row], row_word_[row], static_cast<std::uint32_t>(first_row_ + row), columns_,
                     static_cast<std::uint32_t>(first_column_), wanted, static_cast<std::uint32_t>(row * block), lift_,
                     pending_);
    for (std::size_t k = begin; k < next; ++k) {
      const std::size_t pair = there_[k];
      const std::uint32_t first = kind_[pair] == PairKind::straddle ? 0 : 1;
      if (pilot_[pair] > first) add_rays_of_pair(pair, first, pilot_[pair] - first);
    }
  }
  flush();
}

/// Whether the pair deserves more rays. With few rays of its own only the neighbours are asked: a decision that looked
/// at the pair's own rays would be biased towards what most of them say.
bool PairTile::disagrees(std::size_t pair) const {
  const float own = hidden_[pair];
  const std::uint32_t rays = pilot_[pair];
  if (rays >= 8 && own > 0 && own < 1) return true;
  const std::size_t a = pair / block, b = pair % block;
  float low = 1, high = 0;
  if (rays >= 8) low = high = own;
  for (std::size_t x = a == 0 ? 0 : a - 1; x <= std::min(a + 1, block - 1); ++x) {
    for (std::size_t y = b == 0 ? 0 : b - 1; y <= std::min(b + 1, block - 1); ++y) {
      const std::size_t other = x * block + y;
      if (other == pair || kind_[other] == PairKind::none) continue;
      low = std::min(low, hidden_[other]);
      high = std::max(high, hidden_[other]);
    }
  }
  return high > low;
}

/// False: all pairs are free or all are hidden, nobody disagrees.
bool PairTile::trace_mixed() {
  float low = 1, high = 0;
  for (const std::size_t pair : there_) {
    hidden_[pair] = slots_[pair].hidden_share();
    low = std::min(low, hidden_[pair]);
    high = std::max(high, hidden_[pair]);
  }
  if (low == high && (low == 0 || low == 1)) return false;
  for (const std::size_t pair : there_) {
    if (!disagrees(pair)) continue;
    if (factor_[pair] >= budget_.split_from && kind_[pair] != PairKind::far) {
      trace_cut(pair);
      continue;
    }
    const std::uint32_t have = pilot_[pair], all = std::max(all_rays(factor_[pair]), budget_.fewest_when_mixed);
    if (all > have) add_rays_of_pair(pair, have, all - have);
  }
  flush();
  return true;
}

/// Both patches in quarters: S of the pieces with rays of their own, so that the kernel's peaks (near a common edge) do
/// not meet the coarse sampling of V.
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
      const auto piece = static_cast<std::uint32_t>(cut.s.size());
      const Facet a(Polygon(x), patches_.front(i)), b(Polygon(y), patches_.front(j));
      add_rays({a, b, sampling::start(row_word_[pair / block], static_cast<std::uint32_t>(j), piece),
                sampling::start(column_word_[pair % block], static_cast<std::uint32_t>(i), piece),
                static_cast<std::uint32_t>(slots_.size() - 1), true},
               0, std::max(rays, budget_.fewest_when_mixed));
    }
  }
  slots_[pair] = {};  // the pieces' rays replace the pair's own
  cut_.push_back(std::move(cut));
}

void PairTile::add_rays_of_pair(std::size_t pair, std::uint32_t first, std::uint32_t count) {
  const bool straddling = kind_[pair] == PairKind::straddle;
  const Facet& a = straddling ? parts_[parts_of_[pair]].a : row_facet_[pair / block];
  const Facet& b = straddling ? parts_[parts_of_[pair]].b : column_facet_[pair % block];
  add_rays({a, b, sampling::start(row_word_[pair / block], static_cast<std::uint32_t>(column_patch(pair))),
            sampling::start(column_word_[pair % block], static_cast<std::uint32_t>(row_patch(pair))),
            static_cast<std::uint32_t>(pair), kind_[pair] != PairKind::far},
           first, count);
}

void PairTile::add_rays(const RayStream& stream, std::uint32_t first, std::uint32_t count) {
  while (count > 0) {
    if (pending_.room() == 0) flush();
    const auto some = static_cast<std::uint32_t>(std::min<std::size_t>(count, pending_.room()));
    simd::rays_of(stream, first, some, lift_, pending_);
    first += some;
    count -= some;
  }
}

void PairTile::flush() {
  const Timer timer;
  blockers_.visibility().occluded(pending_);
  trace_seconds_ += timer.seconds();
  rays_ += pending_.size;
  for (std::size_t k = 0; k < pending_.size;) {  // runs of one slot, so that the sums stay in registers
    const std::uint32_t at = pending_.slot[k];
    Slot slot = slots_[at];
    for (; k < pending_.size && pending_.slot[k] == at; ++k) {
      const float w = pending_.weight[k];
      slot.total += w;
      slot.squares += w * w;
      slot.hidden += pending_.far[k] < 0 ? w : 0;
    }
    slots_[at] = slot;
  }
  pending_.size = 0;
}

}  // namespace interflect
