#include "interflect/formfactor/assembly.h"

#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <map>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/closure.h"
#include "interflect/formfactor/hemisphere.h"
#include "interflect/formfactor/pair_tile.h"
#include "interflect/formfactor/patch_table.h"

namespace interflect {

namespace {

// A scene is closed when less than this share of the cosine-distributed rays leaves it, weighted by area: single rays
// do slip through T-junctions and cracks of rounding.
constexpr double closed_below = 1e-4;
// A patch whose factors sum to less than this is buried: set aside from the closure. So is one of whose hemisphere rays
// more than 1 − this share end on backs.
constexpr double buried_below = 0.1;
// The row sums that the closure aims at; 1e-4 is promised.
constexpr double closure_target = 5e-5, closure_promise = 1e-4;

std::string in_units(std::uint64_t bytes) {
  const double mib = static_cast<double>(bytes) / (1024.0 * 1024.0);
  return mib < 1024 ? fmt::format("{:.1f} MiB", mib) : fmt::format("{:.2f} GiB", mib / 1024);
}

constexpr std::uint64_t scratch_per_thread = 1 << 20;

std::uint64_t predicted_memory(std::uint64_t n, std::uint64_t threads) {
  constexpr std::uint64_t hierarchy_per_triangle = 256;  // Embree, high quality
  return FormFactorMatrix::predicted_bytes(n) + PatchTable::predicted_bytes(n) + n * (hierarchy_per_triangle + 64) +
         threads * scratch_per_thread;
}

void check_memory(std::uint64_t n, std::uint64_t limit) {
  if (limit == 0) limit = available_memory();
  const auto threads = static_cast<std::uint64_t>(omp_get_max_threads());
  const std::uint64_t needed = predicted_memory(n, threads);
  if (needed <= limit) return;
  const std::uint64_t least = predicted_memory(n, 1);
  if (least <= limit) {
    throw Error(ErrorKind::limit,
                fmt::format("the form factors of {} patches need {} with {} threads, and {} may be used: set "
                            "OMP_NUM_THREADS to at most {}",
                            n, in_units(needed), threads, in_units(limit), (limit - least) / scratch_per_thread + 1));
  }
  std::uint64_t fits = 0;
  for (std::uint64_t step = std::uint64_t{1} << 31; step > 0; step /= 2) {
    if (predicted_memory(fits + step, threads) <= limit) fits += step;
  }
  throw Error(ErrorKind::limit,
              fmt::format("the form factors of {} patches need {}, and {} may be used: use a larger --divide; about {} "
                          "patches would fit",
                          n, in_units(needed), in_units(limit), fits));
}

/// Pair k of 0 <= row <= column < blocks, by rows.
std::pair<std::size_t, std::size_t> block_pair(std::uint64_t k, std::uint64_t blocks) {
  const auto before = [&](std::uint64_t row) { return row * blocks - row * (row - 1) / 2; };  // pairs in earlier rows
  std::uint64_t low = 0, high = blocks;
  while (high - low > 1) {
    const std::uint64_t middle = (low + high) / 2;
    (before(middle) <= k ? low : high) = middle;
  }
  return {low, low + (k - before(low))};
}

void store(FormFactorMatrix& f, const PatchTable& patches, const PairTile& tile, std::size_t rows,
           std::size_t columns) {
  constexpr std::size_t block = PairTile::block;
  const std::size_t i0 = rows * block, j0 = columns * block;
  const std::size_t height = std::min(block, patches.size - i0), width = std::min(block, patches.size - j0);
  for (std::size_t a = 0; a < height; ++a) {
    const auto row = f.row(static_cast<std::uint32_t>(i0 + a));
    const double scale = patches.area[i0 + a] > 0 ? 1 / patches.area[i0 + a] : 0;
    for (std::size_t b = rows == columns ? a + 1 : 0; b < width; ++b) {
      row[j0 + b] = static_cast<float>(tile.s(a, b) * scale);
    }
  }
  for (std::size_t b = 0; b < width; ++b) {
    const auto row = f.row(static_cast<std::uint32_t>(j0 + b));
    const double scale = patches.area[j0 + b] > 0 ? 1 / patches.area[j0 + b] : 0;
    for (std::size_t a = 0; a < (rows == columns ? b : height); ++a) {
      row[i0 + a] = static_cast<float>(tile.s(a, b) * scale);
    }
  }
}

/// The tiles of all block pairs. Each is written by one task alone, so the threads never meet.
void fill(FormFactorMatrix& f, const PatchTable& patches, const Blockers& blockers, std::uint64_t seed,
          AssemblyReport& report, ProgressSink& progress) {
  const std::uint64_t blocks = patches.blocks(), all = blocks * (blocks + 1) / 2;
  progress.begin("form factors", all);
  std::uint64_t considered = 0, analytic = 0, rays = 0;
  std::exception_ptr failure;
  std::atomic<bool> failed = false;
#pragma omp parallel reduction(+ : considered, analytic, rays)
  {
    const auto guard = [&](const auto& work) {  // no exception may leave the region
      try {
        work();
      } catch (...) {
#pragma omp critical(interflect_assembly)
        if (!failed.exchange(true)) failure = std::current_exception();
      }
    };
    std::unique_ptr<PairTile> tile;
    guard([&] { tile = std::make_unique<PairTile>(patches, blockers, seed); });
#pragma omp for schedule(dynamic, 4)
    for (std::uint64_t k = 0; k < all; ++k) {
      if (failed) continue;
      guard([&] {
        const auto [rows, columns] = block_pair(k, blocks);
        if (tile->compute(rows, columns)) store(f, patches, *tile, rows, columns);
        progress.advance(1);
      });
    }
    if (tile) {
      considered += tile->considered();
      analytic += tile->analytic();
      rays += tile->rays();
    }
  }
  progress.end();
  if (failure) std::rethrow_exception(failure);
  report.pairs_considered = considered;
  report.pairs_analytic = analytic;
  report.rays = rays;
}

/// "lamp 12, table/leg 4, door 2, ...": how many of the patches lie on each object (the group where all objects have
/// one name, the number of the surface where it has none), the most first, three of them.
std::string where(const PatchMesh& mesh, const std::vector<std::uint32_t>& patches) {
  const bool by_group = std::all_of(mesh.surfaces.begin(), mesh.surfaces.end(),
                                    [&](const Surface& s) { return s.object == mesh.surfaces.front().object; });
  std::map<std::string, std::uint32_t> counts;
  for (const std::uint32_t i : patches) {
    const Surface& surface = mesh.surfaces[mesh.surface[i]];
    const std::string& name = by_group && !surface.group.empty() ? surface.group : surface.object;
    ++counts[name.empty() ? fmt::format("surface {}", mesh.surface[i] + 1) : name];
  }
  std::vector<std::pair<std::string, std::uint32_t>> most(counts.begin(), counts.end());
  std::stable_sort(most.begin(), most.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::string out;
  constexpr std::size_t shown = 3;
  for (std::size_t k = 0; k < std::min(shown, most.size()); ++k) {
    out += fmt::format("{}{} {}", k == 0 ? "" : ", ", most[k].first, most[k].second);
  }
  return most.size() > shown ? out + ", ..." : out;
}

RowSums summary(const std::vector<double>& sums, const std::vector<bool>& takes_part) {
  RowSums out;
  std::size_t count = 0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (!takes_part[i]) continue;
    out.min = count == 0 ? sums[i] : std::min(out.min, sums[i]);
    out.max = count == 0 ? sums[i] : std::max(out.max, sums[i]);
    out.mean += sums[i];
    ++count;
  }
  if (count > 0) out.mean /= static_cast<double>(count);
  return out;
}

}  // namespace

FormFactors assemble(const PatchMesh& mesh, const AssemblyOptions& options, ProgressSink* progress) {
  const Timer timer;
  ProgressSink silent;
  ProgressSink& sink = progress != nullptr ? *progress : silent;
  check_memory(mesh.size(), options.memory_limit);

  FormFactors out;
  AssemblyReport& report = out.report;
  const PatchTable patches(mesh);
  const Blockers blockers(mesh, patches);
  out.matrix = FormFactorMatrix(static_cast<std::uint32_t>(mesh.size()));
  fill(out.matrix, patches, blockers, options.seed, report, sink);

  const HemisphereShares shares = look_around(patches, blockers.visibility(), blockers.two_sided(), options.seed);
  report.row_sum = out.matrix.row_sums();
  std::vector<bool> takes_part(mesh.size());
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    takes_part[i] = report.row_sum[i] >= buried_below && static_cast<double>(shares.back[i]) <= 1 - buried_below;
  }
  // What sees nothing cannot open a scene: a cupboard's back that coincides with the wall looks out through it.
  report.escape_fraction = HemisphereShares::mean(patches, shares.escape, takes_part);
  report.back_fraction = HemisphereShares::mean(patches, shares.back, takes_part);
  report.closed_scene =
      std::count(takes_part.begin(), takes_part.end(), true) > 0 && report.escape_fraction < closed_below;

  const bool close = options.closure == Closure::on || (options.closure == Closure::automatic && report.closed_scene);
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    if (!close) takes_part[i] = true;
    if (!takes_part[i]) report.set_aside.push_back(i);
  }
  report.before = summary(report.row_sum, takes_part);

  Scaling scaling;
  if (close) {
    scaling = scale_to_closure(out.matrix, patches.area, takes_part, closure_target);
    report.closure_applied = true;
  } else if (options.closure == Closure::automatic) {
    scaling = cap_row_sums(out.matrix, report.row_sum);
  }
  report.closure_iterations = scaling.iterations;
  report.closure_max_change = scaling.max_change;
  if (scaling.iterations > 0) report.row_sum = out.matrix.row_sums();
  report.after = summary(report.row_sum, takes_part);

  if (close && !report.closed_scene) {
    report.warnings.push_back(fmt::format(
        "closure forced on an open scene: {:.2f} % of the light that would leave it is given to the patches in sight",
        100 * report.escape_fraction));
  }
  if (close && scaling.residual > closure_promise) {
    report.warnings.push_back(fmt::format("closure: a row sum is still off by {:.2g} after {} iterations",
                                          scaling.residual, scaling.iterations));
  }
  if (!scaling.moved.empty()) {
    report.warnings.push_back(
        fmt::format("closure moved the factors of {} patches by more than {:.0f} %, one factor by {:.0f} %: {}",
                    scaling.moved.size(), 100 * moved_much, 100 * scaling.max_change, where(mesh, scaling.moved)));
  }
  if (!report.set_aside.empty()) {
    const auto outward = std::count_if(report.set_aside.begin(), report.set_aside.end(),
                                       [&](std::uint32_t i) { return shares.escape[i] > 0.5F; });
    const bool some_buried = static_cast<std::size_t>(outward) < report.set_aside.size();
    const char* cause = outward == 0  ? "buried in other objects"
                        : some_buried ? "buried in other objects or looking out of the scene"
                                      : "looking out of the scene";
    report.warnings.push_back(fmt::format("{} patches see next to nothing ({}) and are left out of the closure: {}",
                                          report.set_aside.size(), cause, where(mesh, report.set_aside)));
  }
  report.seconds = timer.seconds();
  return out;
}

}  // namespace interflect
