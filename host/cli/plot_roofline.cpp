#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "bench_rows.h"
#include "plot_figures.h"

namespace interflect::cli {

namespace {

constexpr double field_width = 490, plot_left = 62, plot_right = 478, plot_height = 270;

double intensity(const BenchRow& row) {
  return static_cast<double>(row.flops) / static_cast<double>(row.bytes);
}
double gigaflops(const BenchRow& row) {
  return static_cast<double>(row.flops) / row.seconds * 1e-9;
}

/// Single kernels: a solve is many of them, and growth has its own figure.
bool shown(const BenchRow& row) {
  return row.status == "pass" && row.flops > 0 && row.bytes > 0 && row.seconds > 0 && row.what != "growth" &&
         !row.what.starts_with("solve:");
}

/// Vector kernels have open shapes, by their place among the names; products filled circles, by storage.
std::vector<std::string> vector_kernels(const std::vector<BenchRow>& rows) {
  std::vector<std::string> names;
  for (const BenchRow& row : rows) {
    if (shown(row) && row.what != "matvec" && place_of(names, row.what) == names.size()) names.push_back(row.what);
  }
  return names;
}

double radius(const BenchRow& row) {
  return std::clamp(2.0 + 0.9 * std::log2(std::max(1.0, row.n / 500.0)), 2.5, 8.0);
}

struct Axes {
  Axis x, y;
};

Axes axes_of(const std::vector<BenchRow>& rows, const std::vector<std::string>& devices, double top) {
  std::vector<double> x, y;
  for (const BenchRow& row : rows) {
    if (!shown(row)) continue;
    x.push_back(intensity(row));
    y.push_back(gigaflops(row));
  }
  const auto [low, high] = std::minmax_element(x.begin(), x.end());
  for (const std::string& device : devices) {
    for (const char* what : {"read", "copy"}) {
      y.push_back(device_rate(rows, device, what) * *high);
      y.push_back(device_rate(rows, device, what) * *low);
    }
  }
  return {Axis::around(x, plot_left, plot_right), Axis::around(y, top + plot_height, top)};
}

/// Gflop/s = GB/s times intensity, over the whole field: a straight line on logarithmic axes, cut at its edges.
void ceiling(Svg& svg, const Axes& axes, double rate, std::string_view style) {
  if (!(rate > 0)) return;
  const double first = std::max(axes.x.low(), axes.y.low() / rate);
  const double last = std::min(axes.x.high(), axes.y.high() / rate);
  if (first < last) svg.line(axes.x.at(first), axes.y.at(first * rate), axes.x.at(last), axes.y.at(last * rate), style);
}

void draw_device(Svg& svg, const std::vector<BenchRow>& rows, const std::string& device, const Axes& axes, double top) {
  const std::vector<std::string> storages = storages_of(rows), kernels = vector_kernels(rows);
  const double read = device_rate(rows, device, "read"), copy = device_rate(rows, device, "copy");
  svg.text(plot_left, top - 24, shortened(device, 40), "strong");
  svg.text(plot_left, top - 8, fmt::format("read {:.3g} GB/s, copy {:.3g} GB/s", read, copy), "dim");
  draw_axes(svg, axes.x, axes.y, "flop / byte", "Gflop/s", &plain, &plain);
  ceiling(svg, axes, read, "ceiling");
  ceiling(svg, axes, copy, "copy");
  for (const BenchRow& row : rows) {
    if (!shown(row) || row.device != device) continue;
    const bool product = row.what == "matvec";
    const std::string tooltip = fmt::format("{} {}, n = {}: {:.3g} Gflop/s, {:.3g} GB/s, {:.2f} flop/byte", device,
                                            label_of(row), row.n, gigaflops(row), row.gb_per_s(), intensity(row));
    svg.marker(product ? 0 : 1 + place_of(kernels, row.what), axes.x.at(intensity(row)), axes.y.at(gigaflops(row)),
               product ? radius(row) : 4.5,
               product ? colour_class("fill", place_of(storages, row.storage)) : std::string("open"), tooltip);
  }
}

std::vector<LegendEntry> legend(const std::vector<BenchRow>& rows) {
  std::vector<LegendEntry> entries;
  const std::vector<std::string> storages = storages_of(rows), kernels = vector_kernels(rows);
  for (std::size_t k = 0; k < storages.size(); ++k) {
    const bool any = std::any_of(rows.begin(), rows.end(), [&](const BenchRow& row) {
      return shown(row) && row.what == "matvec" && row.storage == storages[k];
    });
    if (any) entries.push_back({0, colour_class("fill", k), "matvec " + storages[k]});
  }
  for (std::size_t k = 0; k < kernels.size(); ++k) entries.push_back({1 + k, "open", kernels[k]});
  return entries;
}

}  // namespace

Figure roofline(const std::vector<BenchRow>& rows) {
  Figure figure;
  std::vector<BenchRow> drawn;
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(drawn), &shown);
  const std::vector<std::string> devices = devices_of(drawn);
  if (devices.empty()) return figure;
  figure.title = "Roofline";
  figure.caption =
      "Each device's kernels under its measured bandwidths: read (line), copy (dashed). Products grow with the "
      "patches.";
  Svg svg;
  double bottom = 0;
  for (std::size_t k = 0; k < devices.size(); ++k) {
    const double top = 44 + static_cast<double>(k / 2) * (plot_height + 100);
    Svg field;
    draw_device(field, rows, devices[k], axes_of(rows, devices, top), top);
    figure.body +=
        fmt::format("<g transform=\"translate({:.0f} 0)\">\n{}</g>\n", k % 2 == 0 ? 0 : field_width + 10, field.body());
    bottom = top + plot_height + 56;
  }
  figure.height = draw_legend(svg, legend(rows), plot_left, bottom + 8, figure_width - 20) + 8;
  figure.body += svg.body();
  return figure;
}

}  // namespace interflect::cli
