#include "interflect/formfactor/assembly.h"

#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/certificate.h"
#include "interflect/formfactor/embree_tiles.h"
#include "interflect/formfactor/estimate.h"
#include "interflect/formfactor/fill.h"
#include "interflect/formfactor/hemisphere.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/streamed_matrix.h"

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

/// "closure forced ...": what a user should know of the closure.
void warn(const PatchMesh& mesh, const HemisphereShares& shares, const Scaling& scaling, AssemblyReport& report) {
  if (report.closure_applied && !report.closed_scene) {
    report.warnings.push_back(fmt::format(
        "closure forced on an open scene: {:.2f} % of the light that would leave it is given to the patches in sight",
        100 * report.escape_fraction));
  }
  if (report.closure_applied && scaling.residual > closure_promise) {
    report.warnings.push_back(fmt::format("closure: a row sum is still off by {:.2g} after {} iterations",
                                          scaling.residual, scaling.iterations));
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
}

}  // namespace

Scaling judge(const PatchMesh& mesh, const PatchTable& patches, const Blockers& blockers,
              const AssemblyOptions& options, const ExchangeProduct& product, AssemblyReport& report) {
  const std::size_t n = mesh.size();
  const HemisphereShares shares = look_around(patches, blockers.visibility(), blockers.two_sided(), options.seed);
  const std::vector<double>& area = mesh.area;
  report.row_sum = row_sums_of(product, area, std::vector<double>(n, 1.0));
  std::vector<bool> takes_part(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    takes_part[i] = report.row_sum[i] >= buried_below && static_cast<double>(shares.back[i]) <= 1 - buried_below;
  }
  // What sees nothing cannot open a scene: a cupboard's back that coincides with the wall looks out through it.
  report.escape_fraction = HemisphereShares::mean(patches, shares.escape, takes_part);
  report.back_fraction = HemisphereShares::mean(patches, shares.back, takes_part);
  report.closed_scene =
      std::count(takes_part.begin(), takes_part.end(), true) > 0 && report.escape_fraction < closed_below;

  // To which of a tile's pairs its variance belongs is a guess: too little for single rows, whence the floor.
  const double eps = 0.5 / std::sqrt(static_cast<double>(options.budget.rays_per_factor));
  std::vector<double> errors = row_errors(report.tile_variance, area);
  for (double& error : errors) error = std::max(error, eps);
  report.certificate = certify(
      mesh, patches,
      {report.row_sum, errors, takes_part, shares.escape, shares.back, hemisphere_rays(n), report.escape_fraction});

  const bool close = options.closure == Closure::on || (options.closure == Closure::automatic && report.closed_scene);
  for (std::uint32_t i = 0; i < n; ++i) {
    if (!close) takes_part[i] = true;
    if (!takes_part[i]) report.set_aside.push_back(i);
  }
  report.before = summary(report.row_sum, takes_part);
  report.row_sum_before = report.row_sum;

  Scaling scaling;
  if (close) {
    scaling = scale_to_closure(product, area, takes_part, closure_target);
    report.closure_applied = true;
  } else if (options.closure == Closure::automatic) {
    scaling = cap_row_sums(report.row_sum);
  } else {
    scaling.d.assign(n, 1.0);
  }
  report.closure_iterations = scaling.iterations;
  if (scaling.iterations > 0) report.row_sum = row_sums_of(product, area, scaling.d);
  report.after = summary(report.row_sum, takes_part);
  warn(mesh, shares, scaling, report);
  return scaling;
}

double AssemblyReport::row_change(std::size_t i) const {
  return row_sum_before[i] > 0 ? std::abs(row_sum[i] / row_sum_before[i] - 1) : 0;
}

std::vector<std::uint32_t> AssemblyReport::moved() const {
  std::vector<std::uint32_t> out;
  for (std::uint32_t i = 0; i < row_sum.size(); ++i) {
    if (row_change(i) > moved_much) out.push_back(i);
  }
  return out;
}

void note_change(const PatchMesh& mesh, const Scaling& scaling, AssemblyReport& report) {
  report.closure_max_change = scaling.max_change;
  if (scaling.max_change <= moved_much) return;  // a row's change is a mean of its factors'
  const std::vector<std::uint32_t> moved = report.moved();
  const double much = 100 * moved_much;
  report.warnings.push_back(fmt::format("closure moved a factor by {:.1f} %, {}", 100 * scaling.max_change,
                                        moved.empty()
                                            ? fmt::format("but the row sum of no patch by more than {:.0f} %", much)
                                            : fmt::format("and the row sums of {} patches by more than {:.0f} %: {}",
                                                          moved.size(), much, where(mesh, moved))));
}

namespace {

/// What makes the tiles: Embree, or what the caller brings.
class Makers {
 public:
  Makers(const AssemblyOptions& options, const PatchTable& patches, const Blockers& blockers)
      : embree_(patches, blockers, options.budget, options.seed),
        other_(options.maker ? options.maker(patches, blockers) : nullptr) {}
  [[nodiscard]] TileMaker& maker() { return other_ ? *other_ : embree_; }

 private:
  EmbreeTiles embree_;
  std::unique_ptr<TileMaker> other_;
};

std::uint64_t all_tiles(std::uint32_t n) {
  const std::uint64_t blocks = (n + PatchTable::block - 1) / PatchTable::block;
  return tiles_in_rows(0, blocks, blocks);
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
  const auto n = static_cast<std::uint32_t>(mesh.size());
  out.matrix = FormFactorMatrix(n);
  Makers makers(options, patches, blockers);
  sink.begin("form factors", all_tiles(n));
  fill(out.matrix, makers.maker(), options.panels, report, sink);
  sink.end();

  sink.begin("closure", 0);
  Scaling scaling = judge(mesh, patches, blockers, options, exchange_product(out.matrix), report);
  sink.end();
  make_form_factors(out.matrix, mesh.area, scaling);
  note_change(mesh, scaling, report);
  report.scaling = std::move(scaling.d);
  report.seconds = timer.seconds();
  return out;
}

std::uint64_t assembly_memory(std::uint64_t patches) {
  return predicted_memory(patches, static_cast<std::uint64_t>(omp_get_max_threads()));
}

AssemblyReport assemble_into(PanelStore& panels, const PatchMesh& mesh, const AssemblyOptions& options,
                             std::uint64_t memory, ProgressSink* progress) {
  const Timer timer;
  ProgressSink silent;
  ProgressSink& sink = progress != nullptr ? *progress : silent;
  const auto n = static_cast<std::uint32_t>(mesh.size());
  const std::uint64_t limit = options.memory_limit != 0 ? options.memory_limit : available_memory();
  const std::uint64_t others = assembly_memory(n) - FormFactorMatrix::predicted_bytes(n);
  if (others + memory > limit) {
    throw Error(ErrorKind::limit,
                fmt::format("{} for the form factors and {} beside them are needed, and {} may be used: use a smaller "
                            "--memory",
                            in_units(memory), in_units(others), in_units(limit)));
  }

  AssemblyReport report;
  const PatchTable patches(mesh);
  const Blockers blockers(mesh, patches);
  Makers makers(options, patches, blockers);
  sink.begin("form factors", all_tiles(n));
  fill_store(n, makers.maker(), panels, memory, report, sink);
  sink.end();

  const StoredPanels stored(panels, n);
  PanelStream stream(stored, memory);
  sink.begin("closure", 0);
  Scaling scaling = judge(mesh, patches, blockers, options, exchange_product(stream), report);
  sink.end();
  scaling.max_change = largest_change(stream, scaling.d);
  note_change(mesh, scaling, report);
  report.scaling = std::move(scaling.d);
  report.seconds = timer.seconds();
  return report;
}

}  // namespace interflect
