#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/reference.h"

// What F needs to stay on a device: matvec_exact and close_rows, by panels, the last first.

namespace interflect {

double matvec_exact_bound(std::uint64_t n) {
  const auto k = static_cast<double>(std::min<std::uint64_t>(n, 128));
  const auto blocks = static_cast<double>((n + 127) / 128);
  return ((k + 3) * (k + 3) / 2 + 2 * (k + 2) + 4 * (blocks + 24)) * 0x1p-48;
}

namespace check {

namespace {

constexpr std::uint32_t most_columns = 24;

/// Panels of `panel_rows` of `rows` rows of n columns; rows, d and x end in sentinels.
struct Case {
  std::uint32_t n = 0, rows = 0, panel_rows = 0, columns = 1;

  [[nodiscard]] std::uint32_t stride() const { return (n + 15) / 16 * 16; }
  [[nodiscard]] std::uint32_t vector_stride() const { return stride() + 16; }
  [[nodiscard]] std::uint64_t seed() const { return std::uint64_t{n} * 2654435761U + columns; }
  [[nodiscard]] MatvecArguments panel(std::uint32_t first) const {
    return {.n = n,
            .first = first,
            .rows = std::min(panel_rows, rows - first),
            .row_stride = stride(),
            .vector_stride = vector_stride()};
  }
};

/// `count` runs of n numbers, each with sentinels up to `stride`.
std::vector<float> padded(Random& random, std::uint32_t count, std::uint32_t n, std::uint32_t stride) {
  std::vector<float> all;
  for (std::uint32_t i = 0; i < count; ++i) {
    std::vector<float> values = random.numbers(n);
    values.resize(stride, sentinel());
    all.insert(all.end(), values.begin(), values.end());
  }
  return all;
}

void launch(Device& device, const Kernel& kernel, std::span<Buffer* const> buffers, const MatvecArguments& a) {
  device.queue().launch(kernel, (a.rows + panel_group - 1) / panel_group, buffers, std::as_bytes(std::span(&a, 1)),
                        "Check resident");
}

std::span<const float> rows_of(const std::vector<float>& all, const MatvecArguments& a) {
  return std::span(all).subspan(std::size_t{a.first} * a.row_stride, std::size_t{a.rows} * a.row_stride);
}

void note(Finding& finding, double error) {
  if (std::isnan(finding.error) || error <= finding.error) return;
  finding.error = error;
}

Finding run_exact(Device& device, const Case& test) {
  Random random(test.seed());
  const std::vector<float> f = padded(random, test.rows, test.n, test.stride());
  const std::vector<float> x = padded(random, test.columns, test.n, test.vector_stride());
  const std::uint32_t length = test.vector_stride();
  const std::size_t half = std::size_t{test.columns} * length;
  const auto kernel = device.kernel("matvec_exact", {{"COLUMNS", static_cast<int>(test.columns)}});
  const GuardedBuffer in(device, x);
  const GuardedBuffer out(device, std::vector<float>(2 * half, sentinel()));
  Finding finding;
  for (std::uint32_t first = (test.rows - 1) / test.panel_rows * test.panel_rows;; first -= test.panel_rows) {
    const MatvecArguments a = test.panel(first);
    const GuardedBuffer panel(device, rows_of(f, a));
    Buffer* const buffers[] = {panel.get(), in.get(), out.get()};
    launch(device, *kernel, buffers, a);
    const std::vector<float> y = out.values(device);
    std::vector<reference::Sum> exact(std::size_t{a.rows} * test.columns);
    reference::matvec_exact(a, test.columns, rows_of(f, a), x, exact);
    for (std::size_t i = 0; i < half; ++i) {
      const std::size_t c = i / length, row = i % length;
      if (row >= first && row < first + a.rows) {
        const reference::Sum& sum = exact[c * a.rows + row - first];
        const double result = static_cast<double>(y[i]) + static_cast<double>(y[half + i]);
        note(finding, std::abs(result - sum.value) / sum.magnitude);
      } else if ((row < first || row >= test.rows) && !(is_sentinel(y[i]) && is_sentinel(y[half + i]))) {
        finding.wrong = fmt::format("element {} of column {} is not the panel's, but was written", row, c);
      }
    }
    if (first == 0) return finding;
  }
}

/// S with zeros in it, and an empty row.
std::vector<float> exchange_areas(Random& random, const Case& test) {
  std::vector<float> s = padded(random, test.rows, test.n, test.stride());
  for (std::uint32_t r = 0; r < test.rows; ++r) {
    for (std::uint32_t j = 0; j < test.n; ++j) {
      float& value = s[std::size_t{r} * test.stride() + j];
      value = (r + 2 * j) % 5 == 0 || (r == 3 && test.rows > 4) ? 0.0F : std::abs(value);
    }
  }
  return s;
}

void compare_rows(Finding& finding, const Case& test, const MatvecArguments& a,
                  const std::vector<reference::Row>& exact, const std::vector<float>& of_rows) {
  for (std::uint32_t i = 0; i < test.vector_stride(); ++i) {
    const bool mine = i >= a.first && i < a.first + a.rows;
    const float low = of_rows[i], high = of_rows[i + a.vector_stride], count = of_rows[i + 2 * a.vector_stride];
    if (mine) {
      const reference::Row& row = exact[i - a.first];
      if (low == row.low && high == row.high && count == static_cast<float>(row.count)) continue;
      finding.wrong = fmt::format("row {}: {} factors of d from {} to {} instead of {} from {} to {}", i, count, low,
                                  high, row.count, row.low, row.high);
    } else if ((i < a.first || i >= test.rows) && !(is_sentinel(low) && is_sentinel(high) && is_sentinel(count))) {
      finding.wrong = fmt::format("row {} is not the panel's, but was written", i);
    }
  }
}

Finding run_close(Device& device, const Case& test) {
  Random random(test.seed());
  const std::vector<float> s = exchange_areas(random, test);
  std::vector<float> d = padded(random, 1, test.n, test.vector_stride());
  for (float& value : d) value = std::abs(value);
  std::vector<float> factor = random.numbers(test.rows);
  factor.resize(test.vector_stride(), sentinel());
  const auto kernel = device.kernel("close_rows", {});
  const GuardedBuffer d_in(device, d), factor_in(device, factor);
  const GuardedBuffer out(device, std::vector<float>(std::size_t{3} * test.vector_stride(), sentinel()));
  Finding finding;
  for (std::uint32_t first = (test.rows - 1) / test.panel_rows * test.panel_rows;; first -= test.panel_rows) {
    const MatvecArguments a = test.panel(first);
    const GuardedBuffer panel(device, rows_of(s, a));
    Buffer* const buffers[] = {panel.get(), d_in.get(), factor_in.get(), out.get()};
    launch(device, *kernel, buffers, a);
    std::vector<double> f(std::size_t{a.rows} * a.n);
    std::vector<reference::Row> rows(a.rows);
    reference::close_rows(a, rows_of(s, a), d, factor, f, rows);
    const std::vector<float> after = panel.values(device);
    for (std::size_t i = 0; i < after.size(); ++i) {
      const std::size_t r = i / a.row_stride, j = i % a.row_stride;
      if (j < a.n) {
        compare(finding, after[i], f[r * a.n + j], std::abs(f[r * a.n + j]));
      } else if (!is_sentinel(after[i])) {
        finding.wrong = fmt::format("padding of row {} was written", a.first + r);
      }
    }
    compare_rows(finding, test, a, rows, out.values(device));
    if (first == 0) return finding;
  }
}

void add(Device& device, std::vector<KernelCheck>& rows, const Selection& selection, std::string_view kernel,
         const Case& test) {
  if (!selection.kernel.empty() && selection.kernel != kernel) return;
  if (test.n > selection.max_size || (selection.columns != 0 && test.columns != selection.columns)) return;
  const bool exact = kernel == "matvec_exact";
  KernelCheck row;
  row.kernel = kernel;
  row.parameters = exact ? fmt::format("COLUMNS={} panel_rows={} seed={}", test.columns, test.panel_rows, test.seed())
                         : fmt::format("panel_rows={} seed={}", test.panel_rows, test.seed());
  row.size = test.n;
  row.bound = exact ? matvec_exact_bound(test.n) : rounding_bound(2);
  add_case(rows, std::move(row), [&] { return exact ? run_exact(device, test) : run_close(device, test); });
}

}  // namespace

void check_resident(Device& device, std::vector<KernelCheck>& rows, const Selection& selection) {
  for (const std::uint32_t n : {1U, 2U, 15U, 16U, 17U, 33U, 65U, 129U, 255U, 257U, 1025U}) {
    const std::uint32_t count = std::min(n, 13U);  // rows
    for (const std::uint32_t panel_rows : {1U, 5U, count}) {
      if (panel_rows > count) continue;
      for (const std::uint32_t columns : {1U, 3U, 7U, most_columns}) {
        if (columns > 3 && panel_rows != count) continue;
        if (columns == most_columns && n != 129 && n != 1025) continue;
        add(device, rows, selection, "matvec_exact", {n, count, panel_rows, columns});
      }
      Selection closing = selection;
      closing.columns = 0;
      add(device, rows, closing, "close_rows", {n, count, panel_rows});
    }
  }
  // Long rows, few of them: past the blocks after which sums join a total.
  for (const std::uint32_t n : {5791U, 40001U}) add(device, rows, selection, "matvec_exact", {n, 6, 6, 3});
}

}  // namespace check

}  // namespace interflect
