#include "interflect/formfactor/embree_tiles.h"

#include <omp.h>

#include <array>
#include <atomic>
#include <exception>
#include <memory>
#include <utility>

namespace interflect {

namespace {

/// Tile k of those from row `first` on, by rows.
std::pair<std::size_t, std::size_t> tile_at(std::uint64_t k, std::uint64_t first, std::uint64_t blocks) {
  std::uint64_t low = first, high = blocks;
  while (high - low > 1) {
    const std::uint64_t middle = (low + high) / 2;
    (tiles_in_rows(first, middle, blocks) <= k ? low : high) = middle;
  }
  return {low, low + (k - tiles_in_rows(first, low, blocks))};
}

constexpr std::size_t pairs = PairTile::block * PairTile::block;

}  // namespace

TileFacts EmbreeTiles::make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink& progress) {
  const std::uint64_t blocks = patches_.blocks(), all = tiles_in_rows(first, end, blocks);
  TileFacts facts;
  facts.variance.assign(all, 0.0F);
  std::uint64_t considered = 0, analytic = 0, rays = 0;
  double tracing = 0;
  int threads = 1;
  std::exception_ptr failure;
  std::atomic<bool> failed = false;
#pragma omp parallel reduction(+ : considered, analytic, rays, tracing)
  {
#pragma omp single nowait
    threads = omp_get_num_threads();
    const auto guard = [&](const auto& work) {  // no exception may leave the region
      try {
        work();
      } catch (...) {
#pragma omp critical(interflect_assembly)
        if (!failed.exchange(true)) failure = std::current_exception();
      }
    };
    std::unique_ptr<PairTile> tile;
    guard([&] { tile = std::make_unique<PairTile>(patches_, blockers_, seed_, budget_); });
    std::array<float, pairs> s;  // NOLINT: written before it is read
#pragma omp for schedule(dynamic, 4)
    for (std::uint64_t k = 0; k < all; ++k) {
      if (failed) continue;
      guard([&] {
        const auto [r, c] = tile_at(k, first, blocks);
        if (tile->compute(r, c)) {
          for (std::size_t p = 0; p < pairs; ++p) s[p] = static_cast<float>(tile->s(p / 32, p % 32));
          sink(r, c, s);
          facts.variance[k] = static_cast<float>(tile->variance());
        }
        progress.advance(1);
      });
    }
    if (tile) {
      considered += tile->considered();
      analytic += tile->analytic();
      rays += tile->rays();
      tracing += tile->trace_seconds();
    }
  }
  if (failure) std::rethrow_exception(failure);
  facts.pairs_considered = considered;
  facts.pairs_analytic = analytic;
  facts.rays = rays;
  facts.trace_seconds = tracing / threads;
  return facts;
}

}  // namespace interflect
