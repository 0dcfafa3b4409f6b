#include "bench_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>

#include "bench_header.h"
#include "interflect/base/error.h"
#include "plot_figures.h"

namespace interflect::cli {

namespace {

/// The table's columns and where they begin in a drawing.
struct Column {
  const char* name;
  double x;
  std::size_t most;  ///< characters
};
constexpr std::array columns{Column{"device", 20, 13},  Column{"what", 112, 19}, Column{"scene", 238, 14},
                             Column{"storage", 335, 9}, Column{"n", 395, 8},     Column{"time", 446, 9},
                             Column{"GB/s", 512, 7},    Column{"share", 564, 6}, Column{"error / bound", 608, 18},
                             Column{"status", 732, 44}};

std::vector<std::string> cells_of(const BenchRow& row) {
  const std::string why = row.reason.empty() ? row.note : row.reason;
  const bool judged = row.error > 0 || row.bound > 0;
  return {row.device,
          row.what,
          row.scene,
          row.storage,
          row.n > 0 ? fmt::format("{}", row.n) : "",
          row.seconds > 0 ? seconds(row.seconds) : "",
          row.bytes > 0 && row.seconds > 0 ? fmt::format("{:.3g}", row.gb_per_s()) : "",
          row.share_of_ceiling() ? fmt::format("{:.2f}", *row.share_of_ceiling()) : "",
          judged ? fmt::format("{:.1e} / {:.1e}", row.error, row.bound) : "",
          why.empty() ? row.status : row.status + ": " + why};
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

Figure row_table(const std::vector<BenchRow>& rows) {
  Figure figure{"Rows", "", 0, ""};
  Svg svg;
  double y = 16;
  for (const Column& column : columns) svg.text(column.x, y, column.name, "dim small");
  for (const BenchRow& row : rows) {
    y += 16;
    const std::vector<std::string> cells = cells_of(row);
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (!cells[k].empty()) svg.text(columns.at(k).x, y, shortened(cells[k], columns.at(k).most), "small");
    }
  }
  figure.height = y + 16;
  figure.body = svg.body();
  return figure;
}

std::vector<Figure> figures_of(const std::vector<BenchRow>& rows) {
  std::vector<Figure> figures;
  for (Figure figure :
       {roofline(rows), shares(rows), solve_times(rows), other_times(rows), growth_curves(growth_of(rows))}) {
    if (figure.height > 0) figures.push_back(std::move(figure));
  }
  return figures;
}

std::string svg_page(const BenchRun& run) {
  std::vector<Figure> figures = figures_of(run.rows);
  figures.push_back(row_table(run.rows));
  Svg head;
  double y = 30;
  head.text(20, y, "interflect bench", "head");
  for (const std::string& line : lines_of(header_text(run.header) + spread_text(run.header))) {
    head.text(20, y += 18, shortened(line, 160), "dim small");
  }
  std::string body = head.body();
  for (const Figure& figure : figures) {
    Svg title;
    title.text(20, y += 44, figure.title, "head");
    if (!figure.caption.empty()) title.text(20, y += 18, figure.caption, "dim");
    body += title.body() + fmt::format("<g transform=\"translate(0 {:.0f})\">\n{}</g>\n", y += 10, figure.body);
    y += figure.height;
  }
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} "
      "{1:.0f}\">\n"
      "<title>interflect bench</title>\n<style>\n{2}</style>\n{3}</svg>\n",
      figure_width, y + 20, style_sheet(), body);
}

std::string html_table(const std::vector<BenchRow>& rows) {
  std::string out = "<div class=\"wide\"><table>\n<thead><tr>";
  for (const Column& column : columns) out += fmt::format("<th>{}</th>", column.name);
  out += "</tr></thead>\n<tbody>\n";
  for (const BenchRow& row : rows) {
    out += fmt::format("<tr class=\"{}\">", escaped(row.status));
    for (const std::string& cell : cells_of(row)) out += fmt::format("<td>{}</td>", escaped(cell));
    out += "</tr>\n";
  }
  return out + "</tbody>\n</table></div>\n";
}

constexpr const char* page_style =
    "body{max-width:1000px;margin:0 auto;padding:16px 20px 40px;font:14px/1.45 system-ui,'Helvetica Neue',Arial,"
    "sans-serif;background:var(--ground);color:var(--ink)}\n"
    "h1{font-size:22px;margin:12px 0 4px}\nh2{font-size:17px;margin:34px 0 2px}\n"
    "p,pre{margin:2px 0 8px;color:var(--dim)}\npre{font-size:12px;white-space:pre-wrap}\n"
    "svg{display:block;width:100%;height:auto}\n.wide{overflow-x:auto}\n"
    "table{border-collapse:collapse;font-size:12px;font-variant-numeric:tabular-nums}\n"
    "th,td{padding:3px 9px 3px 0;text-align:left;white-space:nowrap;border-bottom:1px solid var(--grid)}\n"
    "td:last-child{white-space:normal}\nth{color:var(--dim);font-weight:600}\n"
    ".fail td,.unsupported td{color:var(--c1)}\n";

std::string html_page(const BenchRun& run) {
  std::string out = fmt::format(
      "<!DOCTYPE html>\n<html xmlns=\"http://www.w3.org/1999/xhtml\" lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width\"/>\n<title>interflect "
      "bench</title>\n<style>\n{}{}</style>\n"
      "</head>\n<body>\n<h1>interflect bench</h1>\n<pre>{}</pre>\n",
      style_sheet(), page_style, escaped(header_text(run.header) + spread_text(run.header)));
  for (const Figure& figure : figures_of(run.rows)) {
    out += fmt::format(
        "<h2>{0}</h2>\n<p>{1}</p>\n<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {2:.0f} {3:.0f}\" "
        "role=\"img\" aria-label=\"{0}\">\n{4}</svg>\n",
        escaped(figure.title), escaped(figure.caption), figure_width, figure.height, figure.body);
  }
  return out + "<h2>Rows</h2>\n" + html_table(run.rows) + "</body>\n</html>\n";
}

}  // namespace

std::vector<std::string> devices_of(const std::vector<BenchRow>& rows) {
  std::vector<std::string> names;
  for (const BenchRow& row : rows) {
    if (place_of(names, row.device) == names.size()) names.push_back(row.device);
  }
  return names;
}

std::vector<std::string> storages_of(const std::vector<BenchRow>& rows) {
  std::vector<std::string> names;
  for (const BenchRow& row : rows) {
    if (!row.storage.empty() && place_of(names, row.storage) == names.size()) names.push_back(row.storage);
  }
  return names;
}

std::size_t place_of(const std::vector<std::string>& names, const std::string& name) {
  return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
}

std::string label_of(const BenchRow& row) {
  std::string label = row.what;
  if (!row.scene.empty()) label += " " + row.scene;
  if (!row.storage.empty()) label += " " + row.storage;
  return label;
}

double draw_legend(Svg& svg, const std::vector<LegendEntry>& entries, double x, double y, double right) {
  double at = x;
  for (const LegendEntry& entry : entries) {
    const double width = text_width(entry.text) + 34;
    if (at > x && at + width > right) {
      at = x;
      y += 20;
    }
    svg.marker(entry.shape, at + 6, y - 4, 4.5, entry.style);
    svg.text(at + 17, y, entry.text);
    at += width;
  }
  return y;
}

void check_plot_name(const std::string& file) {
  if (file.ends_with(".html") || file.ends_with(".svg")) return;
  throw Error(ErrorKind::usage, fmt::format("--plot: '{}' ends neither in .html nor in .svg", file));
}

std::string plot(const BenchRun& run, const std::string& file) {
  return file.ends_with(".svg") ? svg_page(run) : html_page(run);
}

}  // namespace interflect::cli
