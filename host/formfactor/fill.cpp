#include "interflect/formfactor/fill.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_table.h"

namespace interflect {

namespace {

/// Writes a tile of S and of its mirror image the rows that the matrix has.
void store(FormFactorMatrix& s, std::size_t r, std::size_t c, std::span<const float> tile) {
  constexpr std::size_t block = PatchTable::block;
  const std::size_t i0 = r * block, j0 = c * block;
  const std::size_t height = std::min<std::size_t>(block, s.size() - i0), width = std::min(block, s.size() - j0);
  for (std::size_t a = 0; a < height; ++a) {
    float* row = s.row(static_cast<std::uint32_t>(i0 + a)).data() + j0;
    for (std::size_t b = r == c ? a + 1 : 0; b < width; ++b) row[b] = tile[a * block + b];
  }
  if (j0 >= s.end_row()) return;
  for (std::size_t b = 0; b < width; ++b) {
    float* row = s.row(static_cast<std::uint32_t>(j0 + b)).data() + i0;
    for (std::size_t a = 0; a < (r == c ? b : height); ++a) row[a] = tile[a * block + b];
  }
}

/// Copies rows [first, end), which came from a store, into the columns of the rows behind them that the matrix has.
void mirror(FormFactorMatrix& s, std::uint32_t first, std::uint32_t end) {
  constexpr std::uint32_t block = PatchTable::block;
  const std::uint32_t blocks = (s.end_row() - end + block - 1) / block;
#pragma omp parallel for schedule(static)
  for (std::uint32_t k = 0; k < blocks; ++k) {
    const std::uint32_t j0 = end + k * block, j1 = std::min(s.end_row(), j0 + block);
    for (std::uint32_t i0 = first; i0 < end; i0 += block) {
      for (std::uint32_t j = j0; j < j1; ++j) {
        for (std::uint32_t i = i0; i < std::min(end, i0 + block); ++i) s.row(j)[i] = std::as_const(s).row(i)[j];
      }
    }
  }
}

void add(AssemblyReport& report, const TileFacts& facts) {
  report.pairs_considered += facts.pairs_considered;
  report.pairs_analytic += facts.pairs_analytic;
  report.rays += facts.rays;
  report.trace_seconds += facts.trace_seconds;
  report.tile_variance.insert(report.tile_variance.end(), facts.variance.begin(), facts.variance.end());
}

/// Reads the columns before the matrix' rows from the panels that lie there: S is symmetric to the bit.
void mirror_stored(FormFactorMatrix& s, const PanelStore& panels) {
  constexpr std::uint32_t block = PatchTable::block;
  const std::uint32_t first = s.first_row(), width = s.end_row() - first, rows = panels.rows_per_panel();
  std::vector<float> columns(std::size_t{first == 0 ? 0 : rows} * width);
  for (std::uint32_t panel = 0; panel * rows < first; ++panel) {
    panels.read_columns(panel, first, width, columns);
#pragma omp parallel for schedule(static)
    for (std::uint32_t c0 = 0; c0 < width; c0 += block) {
      for (std::uint32_t r0 = 0; r0 < rows; r0 += block) {
        for (std::uint32_t c = c0; c < std::min(width, c0 + block); ++c) {
          float* row = s.row(first + c).data() + panel * rows;
          for (std::uint32_t r = r0; r < r0 + block; ++r) row[r] = columns[std::size_t{r} * width + c];
        }
      }
    }
  }
}

}  // namespace

void fill(FormFactorMatrix& s, TileMaker& maker, PanelStore* panels, AssemblyReport& report, ProgressSink& progress) {
  constexpr std::uint32_t block = PatchTable::block;
  const std::uint32_t n = s.size(), blocks = (n + block - 1) / block;
  const std::uint32_t rows = panels != nullptr ? panels->rows_per_panel() : std::max(1U, blocks) * block;
  const TileSink sink = [&](std::size_t r, std::size_t c, std::span<const float> tile) { store(s, r, c, tile); };
  if (panels != nullptr) mirror_stored(s, *panels);
  for (std::uint32_t panel = s.first_row() / rows; std::uint64_t{panel} * rows < s.end_row(); ++panel) {
    const std::uint32_t first = panel * rows / block, end = std::min(blocks, (panel + 1) * rows / block);
    if (panels != nullptr && panels->has(panel)) {
      add(report, panels->load(panel, s));
      mirror(s, panel * rows, std::min(n, (panel + 1) * rows));
      progress.advance(tiles_in_rows(first, end, blocks));
      ++report.panels_reused;
      continue;
    }
    if (panels != nullptr) panels->prepare(panel);
    const TileFacts facts = maker.make(first, end, sink, progress);
    if (panels != nullptr) panels->save(panel, s, facts);
    add(report, facts);
  }
}

void fill_store(std::uint32_t n, TileMaker& maker, PanelStore& panels, std::uint64_t memory, AssemblyReport& report,
                ProgressSink& progress) {
  const std::uint32_t rows = panels.rows_per_panel();
  const std::uint64_t panel_bytes =
      std::max<std::uint64_t>(1, rows * std::uint64_t{FormFactorMatrix::stride_of(n)} * sizeof(float));
  // Columns of one panel take no more than a panel.
  const std::uint64_t at_a_time = memory / panel_bytes;
  if (at_a_time < 2) {
    constexpr double mebibyte = 1 << 20;
    throw Error(ErrorKind::limit,
                fmt::format("two panels of the form factors need {:.1f} MiB, and {:.1f} MiB may be used",
                            2 * static_cast<double>(panel_bytes) / mebibyte, static_cast<double>(memory) / mebibyte));
  }
  const std::uint64_t step = (at_a_time - 1) * rows;
  for (std::uint64_t first = 0; first < n; first += step) {
    FormFactorMatrix s = FormFactorMatrix::rows_only(
        n, static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(std::min<std::uint64_t>(n, first + step)));
    fill(s, maker, &panels, report, progress);
  }
}

}  // namespace interflect
