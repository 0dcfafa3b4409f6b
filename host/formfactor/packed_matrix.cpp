#include "interflect/formfactor/packed_matrix.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <numeric>
#include <string>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/formfactor/pack_row.h"

namespace interflect {

namespace {

constexpr std::uint32_t padding = 16;

std::uint32_t ceil_div(std::uint32_t a, std::uint32_t b) {
  return (a + b - 1) / b;
}

/// Large enough that what a block adds up is small beside its elements, small enough for its slices of vectors to stay
/// in a first-level cache and for a small matrix to have blocks for every core.
std::uint32_t default_block(std::uint32_t n) {
  const std::uint32_t wanted = ceil_div(ceil_div(n, 8), padding) * padding;
  return std::clamp<std::uint32_t>(wanted, 128, 1024);
}

void check_order(std::span<const std::uint32_t> order, std::uint32_t n) {
  if (order.size() != n) {
    throw Error(ErrorKind::usage, fmt::format("storage: an order of {} places for {} patches", order.size(), n));
  }
  std::vector<bool> seen(n);
  for (const std::uint32_t patch : order) {
    if (patch >= n || seen[patch]) {
      throw Error(ErrorKind::usage, fmt::format("storage: patch {} in the order is none or comes twice", patch));
    }
    seen[patch] = true;
  }
}

}  // namespace

PackedMatrix::PackedMatrix(const FormFactorMatrix& form_factors, std::span<const double> area, Storage storage,
                           Options options)
    : n_(form_factors.size()),
      stride_(ceil_div(n_, padding) * padding),
      storage_(storage),
      max_panel_bytes_(options.max_panel_bytes),
      order_(std::move(options.order)) {
  if (storage == Storage::dense32) throw Error(ErrorKind::usage, "storage: dense32 is not a 16-bit format");
  if (area.size() != n_) {
    throw Error(ErrorKind::usage, fmt::format("storage: {} areas for {} patches", area.size(), n_));
  }
  const bool some_rows = form_factors.end_row() - form_factors.first_row() != n_;
  if (some_rows && (storage == Storage::sym16 || !order_.empty() || form_factors.first_row() % tile_rows != 0)) {
    throw Error(ErrorKind::usage,
                "storage: some rows only are packed as dense16 or tiled16, in the patches' own order");
  }
  if (order_.empty()) {
    order_.resize(n_);
    std::iota(order_.begin(), order_.end(), 0U);
  }
  check_order(order_, n_);
  if (storage == Storage::sym16) {
    block_ = options.block != 0 ? options.block : default_block(n_);
    if (block_ % padding != 0) {
      throw Error(ErrorKind::usage, fmt::format("storage: a block of {} rows is no multiple of {}", block_, padding));
    }
    block_rows_ = ceil_div(n_, block_);
  }
  set_scales(area);
  try {
    store_tiles(form_factors);
    inverse_ = {};
  } catch (const std::bad_alloc&) {
    throw Error(ErrorKind::limit, fmt::format("there is no memory for {} patches as {}", n_, name(storage)));
  }
}

void PackedMatrix::set_scales(std::span<const double> area) {
  for (std::uint32_t i = 0; i < n_; ++i) {
    if (std::isfinite(area[i]) && area[i] > 0) continue;
    throw Error(ErrorKind::input, fmt::format("area of patch {}: {} is not positive and finite", i, area[i]));
  }
  const double mean = std::accumulate(area.begin(), area.end(), 0.0) / std::max(1.0, static_cast<double>(n_));
  for (std::vector<float>* scale : {&scale_in_, &scale_out_, &inverse_}) scale->assign(stride_, 0.0F);
  for (std::uint32_t k = 0; k < n_; ++k) {
    scale_in_[k] = static_cast<float>(std::sqrt(area[order_[k]] / mean));
    scale_out_[k] = 1.0F / (element_scale * scale_in_[k]);
    inverse_[k] = 1.0F / scale_in_[k];
    if (std::isnormal(scale_in_[k]) && std::isnormal(scale_out_[k]) && std::isnormal(inverse_[k])) continue;
    throw Error(ErrorKind::input,
                fmt::format("area of patch {}: {} is too far from the mean of {}", order_[k], area[order_[k]], mean));
  }
}

/// The row of H at a place, from the place `first` on; stride_ halves.
void PackedMatrix::place_row(const FormFactorMatrix& form_factors, std::uint32_t place, std::uint32_t first,
                             Half* out) const {
  simd::pack_row(form_factors.row(order_[place]).data(), order_.data(), inverse_.data(),
                 element_scale * scale_in_[place], first, n_, out);
  std::fill(out + n_, out + stride_, Half{0});
}

void PackedMatrix::make_chunks(std::uint64_t max_bytes) {
  const auto units = static_cast<std::uint32_t>(unit_begin_.size() - 1);
  for (std::uint32_t first = 0; first < units;) {
    std::uint32_t end = first + 1;
    while (end < units && (unit_begin_[end + 1] - unit_begin_[first]) * sizeof(Half) <= max_bytes) ++end;
    const std::uint64_t bytes = (unit_begin_[end] - unit_begin_[first]) * sizeof(Half);
    chunks_.push_back({first, end, std::make_shared<PageBuffer>(std::max<std::uint64_t>(bytes, 64))});
    first = end;
  }
}

Half* PackedMatrix::elements(std::uint32_t unit) const {
  const auto after =
      std::partition_point(chunks_.begin(), chunks_.end(), [&](const Chunk& c) { return c.end <= unit; });
  auto* memory = reinterpret_cast<Half*>(after->memory->data());
  return memory + (unit_begin_[unit] - unit_begin_[after->first]);
}

}  // namespace interflect
