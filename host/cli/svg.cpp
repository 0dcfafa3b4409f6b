#include "svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace interflect::cli {

namespace {

/// Bytes of the UTF-8 character that begins there and that XML has; 0 when there is none.
std::size_t character(std::string_view text) {
  const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[k]); };
  if (byte(0) < 0x80) return byte(0) >= 0x20 || byte(0) == '\t' || byte(0) == '\n' ? 1 : 0;
  const std::size_t length = byte(0) >= 0xF0 ? 4 : byte(0) >= 0xE0 ? 3 : 2;
  if (byte(0) < 0xC2 || byte(0) > 0xF4 || text.size() < length) return 0;
  std::uint32_t code = byte(0) & (0xFFU >> (length + 1));
  for (std::size_t k = 1; k < length; ++k) {
    if ((byte(k) & 0xC0U) != 0x80) return 0;
    code = code << 6 | (byte(k) & 0x3FU);
  }
  constexpr std::array<std::uint32_t, 5> least{0, 0, 0x80, 0x800, 0x10000};
  const bool none = code < least.at(length) || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000) || code == 0xFFFE ||
                    code == 0xFFFF;
  return none ? 0 : length;
}

constexpr std::array<const char*, 3> anchors{"start", "middle", "end"};

std::string class_of(std::string_view style) {
  return style.empty() ? "" : fmt::format(" class=\"{}\"", style);
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  while (!text.empty()) {
    const std::size_t length = character(text);
    const char c = text.front();
    if (length == 0)
      out += '?';
    else if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else if (c == '\'')
      out += "&apos;";
    else
      out += text.substr(0, length);
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return out;
}

std::string shortened(const std::string& text, std::size_t most) {
  if (text.size() <= most) return text;
  std::size_t end = most > 3 ? most - 3 : 0;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80) --end;  // not within a character
  return text.substr(0, end) + "...";
}

void Svg::mark(const std::string& element, std::string_view tooltip) {
  body_ += '<' + element;
  if (tooltip.empty())
    body_ += "/>\n";
  else
    body_ += fmt::format("><title>{}</title></{}>\n", escaped(tooltip), element.substr(0, element.find(' ')));
}

void Svg::text(double x, double y, std::string_view text, std::string_view style, Anchor anchor) {
  body_ += fmt::format(
      "<text x=\"{:.1f}\" y=\"{:.1f}\"{}{}>{}</text>\n", x, y,
      anchor == Anchor::start ? "" : fmt::format(" text-anchor=\"{}\"", anchors.at(static_cast<std::size_t>(anchor))),
      class_of(style), escaped(text));
}

void Svg::text_upwards(double x, double y, std::string_view text, std::string_view style) {
  body_ += fmt::format("<text transform=\"translate({:.1f} {:.1f}) rotate(-90)\" text-anchor=\"middle\"{}>{}</text>\n",
                       x, y, class_of(style), escaped(text));
}

void Svg::line(double x1, double y1, double x2, double y2, std::string_view style) {
  mark(fmt::format("line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\"{}", x1, y1, x2, y2, class_of(style)),
       "");
}

void Svg::rect(double x, double y, double width, double height, std::string_view style, std::string_view tooltip) {
  mark(fmt::format("rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\"{}", x, y, std::max(width, 0.5),
                   height, class_of(style)),
       tooltip);
}

void Svg::marker(std::size_t shape, double x, double y, double radius, std::string_view style,
                 std::string_view tooltip) {
  // Corners or strokes around the middle, for a radius of 1.
  constexpr std::array<const char*, marker_shapes> shapes{"",
                                                          "M-.85-.85H.85V.85H-.85Z",
                                                          "M0-1.2L1.2 0L0 1.2L-1.2 0Z",
                                                          "M0-1.1L1.1.85H-1.1Z",
                                                          "M0 1.1L1.1-.85H-1.1Z",
                                                          "M-1.1 0H1.1M0-1.1V1.1",
                                                          "M-.85-.85L.85.85M-.85.85L.85-.85",
                                                          "M-1.1 0H1.1M-.55-.95L.55.95M-.55.95L.55-.95"};
  if (shape % marker_shapes == 0) {
    mark(fmt::format("circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:.1f}\"{}", x, y, radius, class_of(style)), tooltip);
    return;
  }
  mark(fmt::format("path transform=\"translate({:.1f} {:.1f}) scale({:.1f})\" d=\"{}\"{}", x, y, radius,
                   shapes.at(shape % marker_shapes), class_of(style)),
       tooltip);
}

void Svg::path(const std::vector<std::pair<double, double>>& points, std::string_view style) {
  std::string d;
  for (const auto& [x, y] : points) d += fmt::format("{}{:.1f} {:.1f}", d.empty() ? "M" : "L", x, y);
  mark(fmt::format("path d=\"{}\"{}", d, class_of(style)), "");
}

std::string style_sheet() {
  // Okabe and Ito's colours for the colour-blind, darker on white and lighter on black.
  constexpr std::array<const char*, colours> light{"#0067a8", "#c44e00", "#00805c", "#a8447f",
                                                   "#8a6a00", "#2f8fc9", "#5b4bb0", "#7a7a7a"};
  constexpr std::array<const char*, colours> dark{"#5cb3ea", "#f0853c", "#30c296", "#e294c4",
                                                  "#e3bd3c", "#9cd5f5", "#a99cf0", "#b0b0b0"};
  const auto variables = [](const auto& palette, const char* ground, const char* ink, const char* dim, const char* grid,
                            const char* line) {
    std::string out =
        fmt::format(":root{{--ground:{};--ink:{};--dim:{};--grid:{};--rule:{}", ground, ink, dim, grid, line);
    for (std::size_t k = 0; k < palette.size(); ++k) out += fmt::format(";--c{}:{}", k, palette.at(k));
    return out + "}";
  };
  std::string out = variables(light, "#ffffff", "#1b1b1f", "#5a5a63", "#e4e4e8", "#8a8a94") +
                    "\n@media (prefers-color-scheme:dark){" +
                    variables(dark, "#17181c", "#ececf0", "#a5a5b0", "#2e3037", "#777784") + "}\n" +
                    ":root{color-scheme:light dark;background:var(--ground);color:var(--ink)}\n"
                    "svg{background:var(--ground)}\n"
                    "text{font:12px system-ui,'Helvetica Neue',Arial,sans-serif;fill:var(--ink);"
                    "stroke:var(--ground);stroke-width:3px;paint-order:stroke;stroke-linejoin:round}\n"
                    "text.dim{fill:var(--dim)}\n"
                    "text.strong{font-weight:600;font-size:13px}\n"
                    "text.head{font-weight:600;font-size:17px}\n"
                    "text.small{font-size:11px}\n"
                    "line,path{stroke-width:1;fill:none}\n"
                    ".axis{stroke:var(--rule)}\n"
                    ".grid{stroke:var(--grid)}\n"
                    ".ceiling{stroke:var(--ink);stroke-width:1.5}\n"
                    ".copy{stroke:var(--ink);stroke-width:1.5;stroke-dasharray:6 4}\n"
                    ".open{stroke:var(--ink);stroke-width:1.4;fill:none;vector-effect:non-scaling-stroke}\n";
  for (std::size_t k = 0; k < colours; ++k) {
    out += fmt::format(
        ".fill-{0}{{fill:var(--c{0});stroke:var(--ground);stroke-width:.6;vector-effect:non-scaling-stroke}}\n"
        ".line-{0}{{stroke:var(--c{0});stroke-width:1.8}}\n",
        k);
  }
  return out;
}

std::string colour_class(std::string_view kind, std::size_t k) {
  return fmt::format("{}-{}", kind, k % colours);
}

double text_width(std::string_view text, double size) {
  return 0.62 * size * static_cast<double>(text.size());
}

}  // namespace interflect::cli
