#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plot_figures.h"

namespace interflect::cli {

namespace {

constexpr double bar = 12, gap = 9, right_room = 235;

/// Rows of one label, a line for each device.
struct Group {
  std::string label;
  std::vector<const BenchRow*> rows;
};

/// A number per row on lines below each other.
struct Lines {
  std::vector<Group> groups;
  std::vector<std::string> devices;
  double left = 0, top = 0, bottom = 0;
};

Lines lines_of(const std::vector<BenchRow>& rows, bool (*shown)(const BenchRow&), double top) {
  Lines lines;
  lines.devices = devices_of(rows);
  std::size_t count = 0;
  for (const BenchRow& row : rows) {
    if (row.status != "pass" || !(row.seconds > 0) || !shown(row)) continue;
    const std::string label = label_of(row);
    auto found =
        std::find_if(lines.groups.begin(), lines.groups.end(), [&](const Group& g) { return g.label == label; });
    if (found == lines.groups.end()) found = lines.groups.insert(lines.groups.end(), Group{label, {}});
    found->rows.push_back(&row);
    ++count;
    lines.left = std::max(lines.left, text_width(shortened(label, 60)));
  }
  lines.left += 28;
  lines.top = top;
  lines.bottom = top + static_cast<double>(count) * bar + static_cast<double>(lines.groups.size()) * gap + 4;
  return lines;
}

/// Calls draw(row, y of its middle) for every line and writes the labels.
template <class Draw>
void for_each_line(Svg& svg, const Lines& lines, Draw draw) {
  double y = lines.top + gap / 2;
  for (const Group& group : lines.groups) {
    const double height = bar * static_cast<double>(group.rows.size());
    svg.text(lines.left - 8, y + height / 2 + 4, shortened(group.label, 60), "", Svg::Anchor::end);
    for (const BenchRow* row : group.rows) {
      draw(*row, y + bar / 2);
      y += bar;
    }
    y += gap;
  }
}

double draw_devices(Svg& svg, const Lines& lines, double y) {
  std::vector<LegendEntry> entries;
  for (std::size_t k = 0; k < lines.devices.size(); ++k) {
    entries.push_back({1, colour_class("fill", k), shortened(lines.devices[k], 40)});
  }
  return draw_legend(svg, entries, lines.left, y, figure_width - 20);
}

Figure times(const std::vector<BenchRow>& rows, bool (*shown)(const BenchRow&)) {
  Figure figure;
  const Lines lines = lines_of(rows, shown, 30);
  if (lines.groups.empty()) return figure;
  Svg svg;
  draw_devices(svg, lines, 12);
  std::vector<double> values;
  for (const Group& group : lines.groups) {
    for (const BenchRow* row : group.rows) values.insert(values.end(), {row->seconds_min, row->seconds_max});
  }
  const Axis x = Axis::around(values, lines.left, figure_width - right_room);
  draw_x_axis(svg, x, lines.top, lines.bottom, "time, median and range", &seconds);
  for_each_line(svg, lines, [&](const BenchRow& row, double y) {
    const std::size_t k = place_of(lines.devices, row.device);
    svg.line(x.at(std::max(row.seconds_min, x.low())), y, x.at(row.seconds_max), y, colour_class("line", k));
    svg.marker(0, x.at(row.seconds), y, 4, colour_class("fill", k),
               fmt::format("{} {}: {}", row.device, label_of(row), seconds(row.seconds)));
    std::string text = seconds(row.seconds);
    if (row.products > 0) text += fmt::format(", {} products", row.products);
    if (row.launch_share) text += fmt::format(", launches {:.0f} %", 100 * *row.launch_share);
    svg.text(x.to() + 10, y + 4, text, "dim small");
  });
  figure.height = lines.bottom + 42;
  figure.body = svg.body();
  return figure;
}

}  // namespace

Figure shares(const std::vector<BenchRow>& rows) {
  Figure figure;
  const auto shown = [](const BenchRow& row) {
    return row.share_of_ceiling().has_value() && row.what != "growth" && !row.what.starts_with("solve:") &&
           row.what != "read" && row.what != "copy";
  };
  const Lines lines = lines_of(rows, shown, 30);
  if (lines.groups.empty()) return figure;
  figure.title = "Share of the ceiling";
  figure.caption =
      "GB/s over the measured bandwidth of the same reads and writes; of products, over reading the same matrix.";
  Svg svg;
  draw_devices(svg, lines, 12);
  double most = 1;
  for (const Group& group : lines.groups) {
    for (const BenchRow* row : group.rows) most = std::max(most, *row->share_of_ceiling());
  }
  const Axis x(0, std::ceil(most * 5) / 5, lines.left, figure_width - 80, false);
  draw_x_axis(svg, x, lines.top, lines.bottom, "share of the ceiling", &plain);
  svg.line(x.at(1), lines.top, x.at(1), lines.bottom, "copy");
  for_each_line(svg, lines, [&](const BenchRow& row, double y) {
    const double share = *row.share_of_ceiling();
    const std::string text = fmt::format("{:.2f}", share);
    svg.rect(x.from(), y - bar / 2 + 1, x.at(share) - x.from(), bar - 2,
             colour_class("fill", place_of(lines.devices, row.device)),
             fmt::format("{} {}: {} of {:.3g} GB/s", row.device, label_of(row), text, *row.ceiling));
    svg.text(x.at(share) + 5, y + 4, text, "dim small");
  });
  figure.height = lines.bottom + 42;
  figure.body = svg.body();
  return figure;
}

Figure solve_times(const std::vector<BenchRow>& rows) {
  Figure figure = times(rows, [](const BenchRow& row) { return row.what.starts_with("solve:"); });
  figure.title = "Solves";
  figure.caption = "To a relative residual of 1e-6, F in place.";
  return figure;
}

Figure other_times(const std::vector<BenchRow>& rows) {
  Figure figure = times(rows, [](const BenchRow& row) {
    return row.what.starts_with("launch") || row.what == "upload" || row.what == "compile";
  });
  figure.title = "Launches, uploads, compiling";
  figure.caption = "A launch by the hundred, and waited for; F to the device; kernels compiled or from the cache.";
  return figure;
}

}  // namespace interflect::cli
