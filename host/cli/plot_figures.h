#pragma once

#include <string>
#include <vector>

#include "bench_row.h"
#include "power_law.h"
#include "svg.h"

namespace interflect::cli {

inline constexpr double figure_width = 1000;

/// One drawing, figure_width wide.
struct Figure {
  std::string title;
  std::string caption;  ///< one line
  double height = 0;
  std::string body;
};

/// The ids of the rows' devices, and the storages in use, in the order of the rows: a colour each in every figure.
[[nodiscard]] std::vector<std::string> devices_of(const std::vector<BenchRow>& rows);
[[nodiscard]] std::vector<std::string> storages_of(const std::vector<BenchRow>& rows);
/// The place of a name in such a list.
[[nodiscard]] std::size_t place_of(const std::vector<std::string>& names, const std::string& name);

/// "matvec room-9680 sym16": what a row is of, without its device.
[[nodiscard]] std::string label_of(const BenchRow& row);

/// Entries with a marker each, in as many lines as they need from x to `right`. Returns the y below them.
struct LegendEntry {
  std::size_t shape = 0;
  std::string style, text;
};
double draw_legend(Svg& svg, const std::vector<LegendEntry>& entries, double x, double y, double right);

// Each draws verified rows only, and gives a figure of height 0 when there is nothing to draw.

/// Arithmetic intensity against Gflop/s: products and vector kernels under the measured ceilings, a field per device.
[[nodiscard]] Figure roofline(const std::vector<BenchRow>& rows);
/// The share of the ceiling per kernel and storage, a bar per device.
[[nodiscard]] Figure shares(const std::vector<BenchRow>& rows);
/// Median and spread of every solve; of launches, uploads and compiling.
[[nodiscard]] Figure solve_times(const std::vector<BenchRow>& rows);
[[nodiscard]] Figure other_times(const std::vector<BenchRow>& rows);
/// Time per product and bytes against the number of patches, with the fitted laws.
[[nodiscard]] Figure growth_curves(const std::vector<Growth>& growth);

}  // namespace interflect::cli
