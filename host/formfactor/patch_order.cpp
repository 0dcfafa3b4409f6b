#include "interflect/formfactor/patch_order.h"

#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <limits>
#include <numeric>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_clusters.h"
#include "interflect/formfactor/zero_pattern.h"

namespace interflect {

namespace {

/// Which patch of the matrix stands in which place.
std::vector<std::uint32_t> places(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order) {
  constexpr std::uint32_t missing = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> place(form_factors.size(), missing);
  bool sound = order.size() == place.size();
  for (std::uint32_t k = 0; sound && k < order.size(); ++k) {
    sound = order[k] < place.size() && place[order[k]] == missing;
    if (sound) place[order[k]] = k;
  }
  if (!sound) {
    throw Error(ErrorKind::internal,
                fmt::format("the order of {} places is not one of the {} patches", order.size(), place.size()));
  }
  return place;
}

/// What one thread needs to count.
struct Buffer {
  std::vector<std::uint64_t> bits;  ///< a bit per patch
  std::vector<std::uint8_t> holds;  ///< per tile of a row of tiles
};

/// Tiles of row of tiles r, added to `count`.
void count_row_of_tiles(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order,
                        const std::vector<std::uint32_t>& place, std::size_t r, Buffer& buffer, TileCount& count) {
  const std::size_t n = order.size();
  std::fill(buffer.bits.begin(), buffer.bits.end(), 0);
  std::fill(buffer.holds.begin(), buffer.holds.end(), std::uint8_t{0});
  for (std::size_t k = r * tile_rows; k < std::min(n, (r + 1) * tile_rows); ++k) {
    count.nonzero_elements += simd::mark_nonzeros(form_factors.row(order[k]), buffer.bits);
  }
  for (std::size_t w = 0; w < buffer.bits.size(); ++w) {
    for (std::uint64_t left = buffer.bits[w]; left != 0; left &= left - 1) {
      buffer.holds[place[w * 64 + static_cast<std::size_t>(std::countr_zero(left))] / tile_columns] = 1;
    }
  }
  for (std::size_t c = 0; c < buffer.holds.size(); ++c) {
    const bool upper = r * tile_rows <= std::min(n, (c + 1) * tile_columns) - 1;
    count.tiles += 1;
    count.stored += buffer.holds[c];
    count.triangle_tiles += upper ? 1 : 0;
    count.triangle_stored += upper ? buffer.holds[c] : 0;
  }
}

/// Every step-th row of tiles.
TileCount count_some(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order, std::size_t step) {
  const std::vector<std::uint32_t> place = places(form_factors, order);
  const std::size_t n = order.size(), rows = (n + tile_rows - 1) / tile_rows;
  const Buffer empty{std::vector<std::uint64_t>((n + 63) / 64),
                     std::vector<std::uint8_t>((n + tile_columns - 1) / tile_columns)};
  std::vector<Buffer> buffers(static_cast<std::size_t>(omp_get_max_threads()), empty);
  std::vector<TileCount> counts(rows);
#pragma omp parallel for schedule(dynamic, 4)
  for (std::size_t r = 0; r < rows; r += step) {
    count_row_of_tiles(form_factors, order, place, r, buffers[static_cast<std::size_t>(omp_get_thread_num())],
                       counts[r]);
  }
  TileCount sum;
  for (const TileCount& count : counts) {
    sum.stored += count.stored;
    sum.tiles += count.tiles;
    sum.triangle_stored += count.triangle_stored;
    sum.triangle_tiles += count.triangle_tiles;
    sum.nonzero_elements += count.nonzero_elements;
  }
  return sum;
}

double fraction(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

/// An order and the tiles that it stores in a sample of the rows.
struct Candidate {
  std::vector<std::uint32_t> order;
  TileCount count;
};

Candidate sampled(const FormFactorMatrix& form_factors, std::vector<std::uint32_t> order) {
  constexpr std::size_t rows_of_tiles = 128;
  const std::size_t step = std::max<std::size_t>(1, order.size() / tile_rows / rows_of_tiles);
  const TileCount count = count_some(form_factors, order, step);
  return {std::move(order), count};
}

Candidate in_index_order(const FormFactorMatrix& form_factors) {
  std::vector<std::uint32_t> order(form_factors.size());
  std::iota(order.begin(), order.end(), 0);
  return sampled(form_factors, std::move(order));
}

/// One pass from this order on: measured, a second stores as many tiles again. Only where the first order was hardly
/// one at all each pass makes the next one better.
std::vector<std::uint32_t> improved(const FormFactorMatrix& form_factors, Candidate start) {
  constexpr double hardly_any = 0.01, nearly_all = 0.98, no_order = 0.95, worth_it = 0.95;
  constexpr int most_passes = 4;
  const double nonzero = fraction(start.count.nonzero_elements, start.count.tiles * tile_rows * tile_columns);
  if (start.count.stored_fraction() < hardly_any || nonzero > nearly_all) return std::move(start.order);
  const int passes = start.count.stored_fraction() > no_order ? most_passes : 1;
  Candidate best = std::move(start);
  for (int k = 0; k < passes; ++k) {
    Candidate next = sampled(form_factors, joined_by_view(form_factors, best.order));
    if (next.count.stored >= best.count.stored) break;
    const bool go_on = fraction(next.count.stored, best.count.stored) < worth_it;
    best = std::move(next);
    if (!go_on) break;
  }
  return std::move(best.order);
}

}  // namespace

double TileCount::stored_fraction() const {
  return fraction(stored, tiles);
}

double TileCount::triangle_stored_fraction() const {
  return fraction(triangle_stored, triangle_tiles);
}

TileCount count_tiles(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order) {
  return count_some(form_factors, order, 1);
}

std::vector<std::uint32_t> spatial_order(std::span<const Vec3> centre, std::span<const Vec3> normal) {
  constexpr double cells = 1024;  // along each axis: 6 x 10 bits
  Vec3 low = centre.empty() ? Vec3{} : centre[0], high = low;
  for (const Vec3& c : centre) {
    low = {std::min(low.x, c.x), std::min(low.y, c.y), std::min(low.z, c.z)};
    high = {std::max(high.x, c.x), std::max(high.y, c.y), std::max(high.z, c.z)};
  }
  const Vec3 size = high - low;
  const double extent = std::max({size.x, size.y, size.z});
  const auto cell = [](double x) { return x > 0 ? static_cast<std::uint64_t>(std::min(x, cells - 1)) : 0; };

  std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(centre.size());
  for (std::uint32_t i = 0; i < centre.size(); ++i) {
    const Vec3 place = extent > 0 ? (centre[i] - low) / extent : Vec3{};
    const std::array<std::uint64_t, 6> coordinates{cell((normal[i].x + 1) / 2 * cells),
                                                   cell((normal[i].y + 1) / 2 * cells),
                                                   cell((normal[i].z + 1) / 2 * cells),
                                                   cell(place.x * cells),
                                                   cell(place.y * cells),
                                                   cell(place.z * cells)};
    std::uint64_t key = 0;
    for (int bit = 9; bit >= 0; --bit) {
      for (const std::uint64_t c : coordinates) key = key << 1 | (c >> bit & 1);
    }
    keys[i] = {key, i};
  }
  std::sort(keys.begin(), keys.end());
  std::vector<std::uint32_t> order;
  order.reserve(keys.size());
  for (const auto& [key, i] : keys) order.push_back(i);
  return order;
}

std::vector<std::uint32_t> patch_order(const FormFactorMatrix& form_factors) {
  return improved(form_factors, in_index_order(form_factors));
}

std::vector<std::uint32_t> patch_order(const PatchMesh& mesh, const FormFactorMatrix& form_factors) {
  if (mesh.size() != form_factors.size()) {
    throw Error(ErrorKind::internal, fmt::format("the mesh has {} patches and the matrix of form factors {}",
                                                 mesh.size(), form_factors.size()));
  }
  constexpr double clearly_less = 0.9;  // file order, where it is one, knows which patches belong together
  Candidate in_file = in_index_order(form_factors);
  Candidate in_space = sampled(form_factors, spatial_order(mesh.centroid, mesh.normal));
  const bool space = fraction(in_space.count.stored, in_file.count.stored) < clearly_less;
  return improved(form_factors, space ? std::move(in_space) : std::move(in_file));
}

}  // namespace interflect
