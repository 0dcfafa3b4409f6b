#include "interflect/formfactor/rank_assembly.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/embree_tiles.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/rank_fill.h"

namespace interflect {

namespace {

std::uint64_t row_bytes(std::uint32_t n) {
  return std::uint64_t{FormFactorMatrix::stride_of(n)} * sizeof(float);
}

/// S x where each rank has some rows of S. Rank 0 asks; the others answer until it is done.
class SharedProduct {
 public:
  SharedProduct(Ranks& ranks, const std::vector<RowShare>& shares, const FormFactorMatrix& rows)
      : ranks_(ranks), shares_(shares), local_(exchange_product(rows)) {
    for (const RowShare& share : shares) bytes_.push_back((share.end - share.first) * sizeof(double));
  }
  /// On rank 0.
  [[nodiscard]] ExchangeProduct ask() {
    return [this](const std::vector<float>& x) {
      static_cast<void>(ranks_.rank_zeros(true));
      return multiply(x);
    };
  }
  void done() { static_cast<void>(ranks_.rank_zeros(false)); }
  /// On the others.
  void answer(std::size_t n) {
    while (ranks_.rank_zeros(false)) static_cast<void>(multiply(std::vector<float>(n)));
  }

 private:
  std::vector<double> multiply(std::vector<float> x) {
    ranks_.broadcast_values(std::span(x));
    const std::vector<double> y = local_(x);
    std::vector<double> all(x.size());
    const RowShare& own = shares_[ranks_.rank()];
    const auto mine = std::span(y).subspan(own.first, own.end - own.first);
    ranks_.all_gather(std::as_bytes(mine), bytes_, std::as_writable_bytes(std::span(all)));
    return all;
  }

  Ranks& ranks_;
  const std::vector<RowShare>& shares_;
  ExchangeProduct local_;
  std::vector<std::uint64_t> bytes_;
};

/// judge() on rank 0 with products that all share; the others get what they need of it.
Scaling judge_rows(Ranks& ranks, const PatchMesh& mesh, const PatchTable& patches, const Blockers& blockers,
                   const AssemblyOptions& options, const std::vector<RowShare>& shares, const FormFactorMatrix& rows,
                   AssemblyReport& report) {
  SharedProduct product(ranks, shares, rows);
  Scaling scaling;
  if (ranks.rank() == 0) {
    scaling = judge(mesh, patches, blockers, options, product.ask(), report);
    product.done();
  } else {
    product.answer(mesh.size());
    scaling.d.resize(mesh.size());
    report.row_sum.resize(mesh.size());
  }
  ranks.broadcast_values(std::span(scaling.d));
  ranks.broadcast_values(std::span(report.row_sum));
  return scaling;
}

/// S becomes F, and what is known of all ranks' rows.
void finish_rows(Ranks& ranks, const std::vector<double>& area, Scaling& scaling, RankFormFactors& out) {
  make_form_factors(out.own.matrix, area, scaling);
  const std::vector<double> changes = ranks.all_values(scaling.max_change);
  scaling.max_change = *std::max_element(changes.begin(), changes.end());
  const double elements = static_cast<double>(area.size()) * static_cast<double>(area.size());
  out.nonzero_fraction = ranks.sum(std::round(out.own.matrix.nonzero_fraction() * elements)) / elements;
  out.bytes = static_cast<std::uint64_t>(ranks.sum(static_cast<double>(out.own.matrix.bytes())));
}

void close(Ranks& ranks, const PatchMesh& mesh, const PatchTable& patches, const Blockers& blockers,
           const AssemblyOptions& options, const std::vector<RowShare>& shares, RankFormFactors& out,
           ProgressSink& progress) {
  AssemblyReport& report = out.own.report;
  progress.begin("closure", 0);
  Scaling scaling = judge_rows(ranks, mesh, patches, blockers, options, shares, out.own.matrix, report);
  progress.end();
  finish_rows(ranks, mesh.area, scaling, out);
  if (ranks.rank() == 0) note_change(mesh, scaling, report);
  report.scaling = std::move(scaling.d);
}

/// The rows of the own share of S.
FormFactorMatrix rows_from(Ranks& ranks, const IffFile& file, const std::vector<RowShare>& shares) {
  const RowShare& share = shares[ranks.rank()];
  FormFactorMatrix rows;
  agreed(ranks, [&] {
    rows = FormFactorMatrix::rows_only(file.n(), share.first, share.end);
    std::vector<float> panel_rows;
    for (std::uint32_t panel = share.first / file.rows_per_panel(); file.first(panel) < share.end; ++panel) {
      panel_rows.resize(std::size_t{file.rows(panel)} * file.stride());
      file.read_panel(panel, panel_rows);
      for (std::uint32_t k = 0; k < file.rows(panel); ++k) {
        const auto row = std::span(panel_rows).subspan(std::size_t{k} * file.stride(), file.n());
        std::copy(row.begin(), row.end(), rows.row(file.first(panel) + k).begin());
      }
    }
  });
  return rows;
}

}  // namespace

void check_rank_memory(Ranks& ranks, std::uint32_t n, const RowShare& share, std::uint64_t limit) {
  agreed(ranks, [&] {
    const std::uint64_t may = limit != 0 ? limit : available_memory() / ranks.local_size();
    const std::uint64_t beside = assembly_memory(n) - FormFactorMatrix::predicted_bytes(n);
    const std::uint64_t needed = (share.end - share.first) * row_bytes(n) + beside;
    if (needed <= may) return;
    constexpr double mebibyte = 1 << 20;
    throw Error(
        ErrorKind::limit,
        fmt::format("{} of the {} rows of form factors need {:.1f} MiB, and a rank may use {:.1f} MiB: use more "
                    "machines, fewer ranks on each, or a larger --divide",
                    share.end - share.first, n, static_cast<double>(needed) / mebibyte,
                    static_cast<double>(may) / mebibyte));
  });
}

RankFormFactors assemble_rows(Ranks& ranks, const PatchMesh& mesh, const AssemblyOptions& options, RankStore* store,
                              ProgressSink* progress) {
  const Timer timer;
  ProgressSink silent;
  ProgressSink& sink = progress != nullptr ? *progress : silent;
  const auto n = static_cast<std::uint32_t>(mesh.size());
  const std::vector<RowShare> shares =
      store != nullptr ? store->shares() : row_shares(n, ranks.size(), static_cast<std::uint32_t>(PatchTable::block));
  const RowShare& share = shares[ranks.rank()];
  check_rank_memory(ranks, n, share, options.memory_limit);

  RankFormFactors out;
  std::unique_ptr<PatchTable> patches;
  std::unique_ptr<Blockers> blockers;
  std::unique_ptr<TileMaker> maker;
  agreed(ranks, [&] {
    patches = std::make_unique<PatchTable>(mesh);
    blockers = std::make_unique<Blockers>(mesh, *patches);
    out.own.matrix = FormFactorMatrix::rows_only(n, share.first, share.end);
    if (options.maker) maker = options.maker(*patches, *blockers);
    if (!maker) maker = std::make_unique<EmbreeTiles>(*patches, *blockers, options.budget, options.seed);
  });
  if (store != nullptr) store->load(out.own.matrix);
  RankFill fill(ranks, shares, out.own.matrix, *maker, store);
  sink.begin("form factors", fill.tiles());
  fill.run(out.own.report, sink);
  sink.end();
  close(ranks, mesh, *patches, *blockers, options, shares, out, sink);
  out.own.report.seconds = timer.seconds();
  return out;
}

RankFormFactors read_rows(Ranks& ranks, const IffFile& file) {
  const Timer timer;
  const std::vector<RowShare> shares = row_shares(file.n(), ranks.size(), file.rows_per_panel());
  check_rank_memory(ranks, file.n(), shares[ranks.rank()], 0);
  RankFormFactors out;
  agreed(ranks, [&] {
    if (ranks.rank() == 0) {
      out.own.report = file.report();
    } else {
      out.own.report = file.closing().report;
    }
  });
  out.own.matrix = rows_from(ranks, file, shares);
  Scaling scaling;
  scaling.d = out.own.report.scaling;
  finish_rows(ranks, file.area(), scaling, out);
  out.own.report.seconds = timer.seconds();
  return out;
}

RankFormFactors close_rows(Ranks& ranks, const PatchMesh& mesh, const AssemblyOptions& options, const IffFile& file,
                           ProgressSink* progress) {
  const Timer timer;
  ProgressSink silent;
  const std::vector<RowShare> shares = row_shares(file.n(), ranks.size(), file.rows_per_panel());
  check_rank_memory(ranks, file.n(), shares[ranks.rank()], options.memory_limit);
  const PatchTable patches(mesh);
  const Blockers blockers(mesh, patches);
  RankFormFactors out;
  agreed(ranks, [&] {
    AssemblyReport& report = out.own.report;
    for (std::uint32_t panel = 0; ranks.rank() == 0 && panel < file.panels(); ++panel) {
      const TileFacts facts = file.facts(panel);
      report.pairs_considered += facts.pairs_considered;
      report.pairs_analytic += facts.pairs_analytic;
      report.rays += facts.rays;
      report.tile_variance.insert(report.tile_variance.end(), facts.variance.begin(), facts.variance.end());
    }
    report.panels_reused = file.panels();
  });
  out.own.matrix = rows_from(ranks, file, shares);
  close(ranks, mesh, patches, blockers, options, shares, out, progress != nullptr ? *progress : silent);
  out.own.report.seconds = timer.seconds();
  return out;
}

}  // namespace interflect
