#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <cstring>
#include <exception>

#include "interflect/base/error.h"
#include "interflect/formfactor/packed_matrix.h"

// The formats of tiles: which are stored, in which order, and the panels' index of them.

namespace interflect {

namespace {

constexpr std::uint32_t rows = tile_rows, columns = tile_columns;

std::uint32_t count_nonzero(const Half* tile) {
  return tile_elements - static_cast<std::uint32_t>(std::count(tile, tile + tile_elements, Half{0}));
}

/// Keeps of the tile at a row and column what lies above the diagonal, and half of what lies on it. How many of these
/// halves are not zero.
std::uint32_t keep_upper(Half* tile, std::uint32_t row, std::uint32_t column) {
  std::uint32_t on_diagonal = 0;
  for (std::uint32_t q = 0; q < rows; ++q) {
    for (std::uint32_t l = 0; l < columns; ++l) {
      Half& value = tile[q * columns + l];
      if (column + l < row + q) value = 0;
      if (column + l != row + q) continue;
      value = to_half(from_half(value) / 2);
      on_diagonal += value != 0 ? 1 : 0;
    }
  }
  return on_diagonal;
}

}  // namespace

/// Throws a limit Error when packing needs more than may be used: its tiles exist twice until they have their place.
void PackedMatrix::check_memory(std::uint64_t needed) const {
  const std::uint64_t available = available_memory();
  if (needed <= available) return;
  throw Error(ErrorKind::limit,
              fmt::format("packing {} patches as {} needs {:.2f} GiB, {:.2f} may be used", n_, name(storage_),
                          static_cast<double>(needed) / (1 << 30), static_cast<double>(available) / (1 << 30)));
}

/// One thread's tiles before they have their place: memory by huge pages, since the system takes its time to hand out a
/// small page.
class PackedMatrix::Arena {
 public:
  /// Room for so many halves at least.
  Half* room(std::size_t halves) {
    if (memory_.empty() || memory_.back().size() - used_ < halves * sizeof(Half)) {
      memory_.emplace_back(std::max(halves * sizeof(Half), std::min(std::size_t{32} << 20U, 2 * taken_)));
      taken_ += memory_.back().size();
      used_ = 0;
    }
    return reinterpret_cast<Half*>(memory_.back().data() + used_);
  }
  void take(std::size_t halves) { used_ += halves * sizeof(Half); }

 private:
  std::vector<PageBuffer> memory_;
  std::size_t used_ = 0;
  std::size_t taken_ = std::size_t{1} << 20U;  // bytes, and a start: small matrices need little
};

/// The tiles of a strip that are stored, with their columns; `buffer` has room for 8 rows.
void PackedMatrix::make_strip(const FormFactorMatrix& form_factors, std::uint32_t strip, std::span<Half> buffer,
                              Arena& arena, Made& made) const {
  if (strip * rows < form_factors.first_row() || strip * rows >= form_factors.end_row()) return;
  const bool upper = storage_ == Storage::sym16;
  const std::uint32_t first = upper ? strip * rows / columns : 0;
  for (std::uint32_t q = 0; q < rows; ++q) {
    Half* row = buffer.data() + std::size_t{q} * stride_;
    if (strip * rows + q < n_) {
      place_row(form_factors, strip * rows + q, first * columns, row);
    } else {
      std::fill_n(row, stride_, Half{0});
    }
  }
  Half* end = arena.room(std::size_t{rows} * stride_);
  made.elements = end;
  for (std::uint32_t t = first; t < stride_ / columns; ++t) {
    Half* tile = end;
    for (std::uint32_t q = 0; q < rows; ++q) {
      std::memcpy(tile + q * columns, buffer.data() + std::size_t{q} * stride_ + std::size_t{t} * columns,
                  columns * sizeof(Half));
    }
    const std::uint32_t on_diagonal = upper && t == first ? keep_upper(tile, strip * rows, t * columns) : 0;
    const std::uint32_t nonzero = count_nonzero(tile);
    if (nonzero == 0 && storage_ != Storage::dense16) continue;
    end += tile_elements;
    made.columns.push_back(t);
    made.nonzero += upper ? 2 * nonzero - on_diagonal : nonzero;
  }
  arena.take(made.columns.size() * tile_elements);
}

void PackedMatrix::store_tiles(const FormFactorMatrix& form_factors) {
  const std::uint32_t strips = (n_ + rows - 1) / rows;
  std::vector<Made> made(strips);
  const std::uint32_t own = form_factors.end_row() - form_factors.first_row();
  if (storage_ == Storage::dense16) check_memory(std::uint64_t{2} * own * stride_ * sizeof(Half));
  std::vector<Arena> arenas(static_cast<std::size_t>(omp_get_max_threads()));
  std::exception_ptr failure;  // none may leave the parallel region
#pragma omp parallel
  {
    Arena& arena = arenas[static_cast<std::size_t>(omp_get_thread_num())];
    std::vector<Half> buffer;
#pragma omp for schedule(dynamic, 4)
    for (std::uint32_t s = 0; s < strips; ++s) {
      try {
        buffer.resize(std::size_t{rows} * stride_);
        make_strip(form_factors, s, buffer, arena, made[s]);
      } catch (...) {
#pragma omp critical
        failure = std::current_exception();
      }
    }
  }
  if (failure) std::rethrow_exception(failure);
  std::uint64_t tiles = 0;
  for (const Made& strip : made) tiles += strip.columns.size();
  check_memory(tiles * tile_elements * sizeof(Half));
  lay_out(made);
  make_chunks(max_panel_bytes_);
  place_tiles(made);
  std::uint64_t nonzero = 0;
  for (const Made& strip : made) nonzero += strip.nonzero;
  nonzero_fraction_ = static_cast<double>(nonzero) / std::max(1.0, static_cast<double>(n_) * n_);
  // As add_index() writes them: the tiles' columns, where each strip begins, and for blocks their heads and their
  // strips.
  const std::uint64_t strips_written = strips_.size() - 1;
  std::uint64_t index = columns_.size() + strips_written + chunks_.size();
  if (storage_ == Storage::sym16) index += strips_written + std::uint64_t{4} * units();
  bytes_ = unit_begin_.back() * sizeof(Half) + index * sizeof(std::uint32_t);
}

/// The tiles of some strips whose tile columns lie in [first_column, end_column) as the next unit; for sym16, which
/// names its blocks, only if there are any.
void PackedMatrix::add_unit(const std::vector<Made>& made, std::uint32_t first_strip, std::uint32_t end_strip,
                            std::uint32_t first_column, std::uint32_t end_column) {
  const std::size_t before = columns_.size();
  for (std::uint32_t s = first_strip; s < end_strip; ++s) {
    const auto begin = std::lower_bound(made[s].columns.begin(), made[s].columns.end(), first_column);
    const auto end = std::lower_bound(begin, made[s].columns.end(), end_column);
    if (begin == end && storage_ == Storage::sym16) continue;
    strips_.push_back({s, columns_.size()});
    columns_.insert(columns_.end(), begin, end);
  }
  if (columns_.size() == before && storage_ == Storage::sym16) return;
  unit_begin_.push_back(columns_.size() * std::uint64_t{tile_elements});
  unit_strips_.push_back(static_cast<std::uint32_t>(strips_.size()));
}

void PackedMatrix::lay_out(const std::vector<Made>& made) {
  const auto strips = static_cast<std::uint32_t>(made.size());
  const std::uint32_t all = stride_ / columns;
  unit_strips_.push_back(0);
  if (storage_ != Storage::sym16) {
    for (std::uint32_t s = 0; s < strips; ++s) add_unit(made, s, s + 1, 0, all);
  } else {
    const std::uint32_t high = block_ / rows, wide = block_ / columns;
    for (std::uint32_t i = 0; i < block_rows_; ++i) {
      for (std::uint32_t j = i; j < block_rows_; ++j) {
        add_unit(made, i * high, std::min(strips, (i + 1) * high), j * wide, std::min(all, (j + 1) * wide));
      }
    }
  }
  strips_.push_back({strips, columns_.size()});
}

void PackedMatrix::place_tiles(const std::vector<Made>& made) {
  const std::uint32_t count = units();
#pragma omp parallel for schedule(dynamic)
  for (std::uint32_t u = 0; u < count; ++u) {
    Half* to = elements(u);
    for (std::uint32_t s = unit_strips_[u]; s < unit_strips_[u + 1]; ++s) {
      const std::uint64_t tiles = strips_[s + 1].first_tile - strips_[s].first_tile;
      if (tiles == 0) continue;
      const Made& from = made[strips_[s].row];
      const auto at = std::lower_bound(from.columns.begin(), from.columns.end(), columns_[strips_[s].first_tile]);
      const std::size_t halves = tiles * tile_elements;
      std::memcpy(to, from.elements + (at - from.columns.begin()) * std::ptrdiff_t{tile_elements},
                  halves * sizeof(Half));
      to += halves;
    }
  }
}

PackedMatrix::BlockPlace PackedMatrix::block_of(std::uint32_t unit) const {
  const Strip& strip = strips_[unit_strips_[unit]];
  return {strip.row * rows / block_, columns_[strip.first_tile] * columns / block_};
}

void PackedMatrix::add_index(Panel& made) const {
  const std::uint32_t first = unit_strips_[made.first], end = unit_strips_[made.first + made.units];
  const std::uint64_t first_tile = strips_[first].first_tile;
  made.strips = end - first;
  made.tiles = static_cast<std::uint32_t>(strips_[end].first_tile - first_tile);
  const std::uint32_t high = block_ / rows, wide = block_ / columns;
  if (storage_ == Storage::sym16) {
    for (std::uint32_t u = made.first; u < made.first + made.units; ++u) {
      const Strip& strip = strips_[unit_strips_[u]];
      made.index.insert(made.index.end(), {strip.row / high, columns_[strip.first_tile] / wide, unit_strips_[u] - first,
                                           unit_strips_[u + 1] - first});
    }
    for (std::uint32_t s = first; s < end; ++s) made.index.push_back(strips_[s].row % high);
  }
  for (std::uint32_t s = first; s <= end; ++s) {
    made.index.push_back(static_cast<std::uint32_t>(strips_[s].first_tile - first_tile));
  }
  for (std::uint64_t t = first_tile; t < strips_[end].first_tile; ++t) {
    made.index.push_back(storage_ == Storage::sym16 ? columns_[t] % wide : columns_[t]);
  }
}

PackedMatrix::Panel PackedMatrix::panel(std::uint32_t first, std::uint32_t end) const {
  Panel made;
  made.first = first;
  made.units = end - first;
  const std::uint64_t halves = unit_begin_[end] - unit_begin_[first];
  made.elements = std::as_bytes(std::span(elements(first), halves));
  add_index(made);
  return made;
}

std::vector<PackedMatrix::Panel> PackedMatrix::panels(std::uint64_t max_bytes, std::uint32_t max_units,
                                                      std::uint32_t first_unit, std::uint32_t end_unit) const {
  std::vector<Panel> all;
  for (const Chunk& chunk : chunks_) {
    const std::uint32_t chunk_first = std::max(first_unit, chunk.first), chunk_end = std::min(end_unit, chunk.end);
    for (std::uint32_t first = chunk_first; first < chunk_end;) {
      const auto bytes = [&](std::uint32_t end) { return (unit_begin_[end] - unit_begin_[first]) * sizeof(Half); };
      std::uint32_t end = first + 1;
      if (bytes(end) > max_bytes) {
        throw Error(ErrorKind::limit, fmt::format("{} of the form factors as {} have {} bytes, a buffer takes {}; use "
                                                  "fewer patches or another device",
                                                  storage_ == Storage::sym16 ? "one block" : "one row or strip",
                                                  name(storage_), bytes(end), max_bytes));
      }
      while (end < chunk_end && end - first < max_units && bytes(end + 1) <= max_bytes) ++end;
      all.push_back(panel(first, end));
      // What the limits cut is copied; all that a chunk has of what was asked for may be used in place.
      Panel& made = all.back();
      if (first == chunk.first && end == chunk.end) {
        made.shared = chunk.memory;
      } else if (first == chunk_first && end == chunk_end && !made.elements.empty()) {
        const std::uint64_t offset = (unit_begin_[first] - unit_begin_[chunk.first]) * sizeof(Half);
        made.shared = PageBuffer::part(chunk.memory, offset, made.elements.size());
      }
      first = end;
    }
  }
  return all;
}

}  // namespace interflect
