#include <fmt/format.h>

#include <algorithm>

#include "plot_figures.h"

namespace interflect::cli {

namespace {

constexpr double plot_top = 36, plot_height = 300;

using Value = double (*)(const BenchRow&);

struct Field {
  std::string title, name;
  Value value;
  std::optional<PowerLaw> Growth::*law;
  Label label;
  double left, right;
};

void draw_field(Svg& svg, const std::vector<Growth>& growth, const Field& field) {
  std::vector<double> sizes, values;
  for (const Growth& one : growth) {
    for (const BenchRow* row : one.rows) {
      sizes.push_back(row->n);
      values.push_back(field.value(*row));
    }
  }
  const Axis x = Axis::around(sizes, field.left, field.right);
  const Axis y = Axis::around(values, plot_top + plot_height, plot_top);
  svg.text(field.left, plot_top - 14, field.title, "strong");
  draw_axes(svg, x, y, "patches", field.name, &count, field.label);
  for (std::size_t k = 0; k < growth.size(); ++k) {
    const Growth& one = growth[k];
    if (one.storage == "assembly") {  // what N^2 would be, through the largest size
      const BenchRow& first = *one.rows.front();
      const BenchRow& last = *one.rows.back();
      const double ratio = static_cast<double>(first.n) / last.n;
      svg.line(x.at(first.n), y.at(field.value(last) * ratio * ratio), x.at(last.n), y.at(field.value(last)), "copy");
    }
    if (const std::optional<PowerLaw>& law = one.*field.law) {
      const double first = one.rows.front()->n, last = one.rows.back()->n;
      svg.line(x.at(first), y.at(law->at(first)), x.at(last), y.at(law->at(last)), colour_class("line", k));
    }
    for (const BenchRow* row : one.rows) {
      svg.marker(
          k % marker_shapes < 5 ? k % marker_shapes : 0, x.at(row->n), y.at(field.value(*row)), 4.5,
          colour_class("fill", k),
          fmt::format("{} {} growth, n = {}: {}", row->device, one.storage, row->n, field.label(field.value(*row))));
    }
  }
}

std::string law_text(const std::optional<PowerLaw>& law) {
  if (!law) return "too few sizes";
  return law->holds() ? fmt::format("n^{:.2f}", law->exponent) : fmt::format("n^{:.2f} (no power law)", law->exponent);
}

}  // namespace

Figure growth_curves(const std::vector<Growth>& growth) {
  Figure figure;
  if (growth.empty()) return figure;
  figure.title = "Growth";
  figure.caption =
      "One room cut into ever more patches; the lines are the fitted power laws, dashed: N² through the largest of an "
      "assembly.";
  Svg svg;
  draw_field(svg, growth,
             {"Time", "seconds", [](const BenchRow& row) { return row.seconds; }, &Growth::time, &seconds, 80, 480});
  draw_field(svg, growth,
             {"Bytes of F", "bytes", [](const BenchRow& row) { return static_cast<double>(row.bytes); }, &Growth::bytes,
              &bytes, 580, 980});
  std::vector<LegendEntry> entries;
  for (std::size_t k = 0; k < growth.size(); ++k) {
    const Growth& one = growth[k];
    entries.push_back({k % marker_shapes < 5 ? k % marker_shapes : 0, colour_class("fill", k),
                       fmt::format("{} {}: time {}, bytes {}", shortened(one.device, 30), one.storage,
                                   law_text(one.time), law_text(one.bytes))});
  }
  figure.height = draw_legend(svg, entries, 80, plot_top + plot_height + 62, figure_width - 20) + 8;
  figure.body = svg.body();
  return figure;
}

}  // namespace interflect::cli
