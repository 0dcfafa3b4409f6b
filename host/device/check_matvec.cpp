#include <fmt/format.h>

#include <algorithm>

#include "interflect/base/error.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/reference.h"

// matvec: all sizes, columns and panels against the reference.

namespace interflect {

double matvec_bound(std::uint64_t n) {
  return check::rounding_bound(std::min<std::uint64_t>(n, 256) + (n + 255) / 256 + 5);
}

namespace check {

namespace {

constexpr std::uint32_t most_columns = 24;  // of columns.h, a floor above

/// A matrix of n columns with its vectors and the exact products, shared by all cases of that size.
struct Problem {
  Problem(std::uint32_t size, std::uint32_t with_columns, std::uint32_t with_rows)
      : n(size),
        rows(with_rows),
        stride((size + 15) / 16 * 16),
        columns(with_columns),
        seed(std::uint64_t{size} * 2654435761U) {
    Random random(seed);
    for (std::uint32_t i = 0; i < rows; ++i) append(f, random.numbers(n), sentinel());
    // A column longer than needed by a line, so that first, n and the stride differ.
    for (std::uint32_t c = 0; c < columns; ++c) append(x, random.numbers(n), sentinel());
    exact.resize(std::size_t{rows} * columns);
    reference::matvec(arguments(0, rows), columns, f, x, exact);
  }

  [[nodiscard]] std::uint32_t vector_stride() const { return stride + 16; }
  [[nodiscard]] MatvecArguments arguments(std::uint32_t first, std::uint32_t count) const {
    return {.n = n, .first = first, .rows = count, .row_stride = stride, .vector_stride = vector_stride()};
  }

  std::uint32_t n;
  std::uint32_t rows;
  std::uint32_t stride;
  std::uint32_t columns;
  std::uint64_t seed;
  std::vector<float> f;
  std::vector<float> x;
  std::vector<reference::Sum> exact;

 private:
  void append(std::vector<float>& to, std::vector<float> values, float padding) const {
    values.resize(&to == &f ? stride : vector_stride(), padding);
    to.insert(to.end(), values.begin(), values.end());
  }
};

/// What y holds after the rows [done, problem.rows) have been computed: those sums, and sentinels everywhere else.
void compare_rows(Finding& finding, const Problem& problem, std::uint32_t columns, std::uint32_t done,
                  const std::vector<float>& y) {
  const std::uint32_t length = problem.vector_stride();
  for (std::uint32_t i = 0; i < columns * length; ++i) {
    const std::uint32_t c = i / length;
    const std::uint32_t row = i % length;
    if (row >= done && row < problem.rows) {
      const reference::Sum& sum = problem.exact[std::size_t{c} * problem.rows + row];
      compare(finding, y[i], sum.value, sum.magnitude);
    } else if (!is_sentinel(y[i])) {
      finding.wrong = fmt::format("element {} of column {} is not the panel's, but was written", row, c);
    }
  }
}

/// The panels one by one, the last first; each is held against the reference at once.
Finding run(Device& device, const Problem& problem, const Macros& macros, std::uint32_t columns,
            std::uint32_t panel_rows) {
  const auto group = static_cast<std::uint32_t>(macros.at("ROWS"));
  const auto kernel = device.kernel("matvec", macros);
  const std::size_t length = std::size_t{columns} * problem.vector_stride();
  const GuardedBuffer x(device, std::span(problem.x).first(length));
  const GuardedBuffer y(device, std::vector<float>(length, sentinel()));
  Finding finding;
  const std::uint32_t panels = (problem.rows + panel_rows - 1) / panel_rows;
  for (std::uint32_t p = panels; p-- > 0;) {
    const std::uint32_t first = p * panel_rows;
    const MatvecArguments arguments = problem.arguments(first, std::min(panel_rows, problem.rows - first));
    const GuardedBuffer f(device, std::span(problem.f).subspan(std::size_t{first} * problem.stride,
                                                               std::size_t{arguments.rows} * problem.stride));
    Buffer* const buffers[] = {f.get(), x.get(), y.get()};
    const std::uint32_t groups = (arguments.rows + group - 1) / group;
    device.queue().launch(*kernel, groups, buffers, std::as_bytes(std::span(&arguments, 1)), "Check matvec");
    compare_rows(finding, problem, columns, first, y.values(device));
  }
  return finding;
}

void add(Device& device, std::vector<KernelCheck>& rows, const Selection& selection, const Problem& problem,
         std::uint32_t columns, std::uint32_t panel_rows) {
  KernelCheck row;
  row.kernel = "matvec";
  row.parameters = fmt::format("COLUMNS={} panel_rows={} seed={}", columns, panel_rows, problem.seed);
  row.size = problem.n;
  row.bound = matvec_bound(problem.n);
  const Macros macros = case_macros(device.info(), "matvec", selection, columns);
  add_case(rows, std::move(row), [&] { return run(device, problem, macros, columns, panel_rows); });
}

}  // namespace

void check_matvec(Device& device, std::vector<KernelCheck>& rows, const Selection& selection) {
  const auto wanted = [&](std::uint32_t columns) { return selection.columns == 0 || columns == selection.columns; };
  for (const std::uint32_t n : {1U, 2U, 15U, 16U, 17U, 31U, 32U, 33U, 63U, 64U, 65U, 255U, 256U, 257U}) {
    if (n > selection.max_size) continue;
    const Problem problem(n, most_columns, n);
    for (const std::uint32_t columns : {1U, 2U, 3U, 4U, 5U, 6U, 7U, most_columns}) {
      if (!wanted(columns)) continue;
      add(device, rows, selection, problem, columns, n);
      if (n > 1) add(device, rows, selection, problem, columns, (n + 2) / 3);
    }
    if (!wanted(3)) continue;
    if (n > 1 && n <= 33) add(device, rows, selection, problem, 3, 1);
    if (n > 5) add(device, rows, selection, problem, 3, 5);
  }
  for (const std::uint32_t n : {1023U, 1025U, 1312U, 1313U}) {
    if (n > selection.max_size) continue;
    const Problem problem(n, 7, n);
    for (const std::uint32_t columns : {3U, 7U}) {
      if (wanted(columns)) add(device, rows, selection, problem, columns, n);
    }
    if (wanted(3)) add(device, rows, selection, problem, 3, 501);
  }
  // Eight light groups: past a block of a row and past the columns in registers at once.
  for (const std::uint32_t n : {1025U, 5791U}) {
    if (n > selection.max_size || !wanted(most_columns)) continue;
    const Problem problem(n, most_columns, 37);
    add(device, rows, selection, problem, most_columns, 37);
    add(device, rows, selection, problem, most_columns, 16);
  }
  // Long rows, few of them: past the blocks and segments into which a kernel cuts a row.
  for (const std::uint32_t n : {5791U, 17128U}) {
    if (n > selection.max_size) continue;
    const Problem problem(n, 7, 19);
    for (const std::uint32_t columns : {3U, 7U}) {
      if (wanted(columns)) add(device, rows, selection, problem, columns, 19);
    }
    if (wanted(3)) add(device, rows, selection, problem, 3, 5);
  }
}

}  // namespace check

}  // namespace interflect
