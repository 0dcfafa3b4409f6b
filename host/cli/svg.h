#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace interflect::cli {

/// Text for XML: the five characters escaped; bytes that are no UTF-8, and characters that XML has not, become '?'.
[[nodiscard]] std::string escaped(std::string_view text);

/// The first characters of a text with dots behind them, so that at most `most` are left.
[[nodiscard]] std::string shortened(const std::string& text, std::size_t most);

/// A drawing in the making: the inside of an <svg>, in pixels from the top left.
class Svg {
 public:
  enum class Anchor { start, middle, end };
  /// `style` is a class of style_sheet(), several between blanks.
  void text(double x, double y, std::string_view text, std::string_view style = "", Anchor anchor = Anchor::start);
  /// Written from bottom to top, its middle at y.
  void text_upwards(double x, double y, std::string_view text, std::string_view style = "");
  void line(double x1, double y1, double x2, double y2, std::string_view style);
  /// The tooltip is what the reader sees with the pointer on it, and what a program reads.
  void rect(double x, double y, double width, double height, std::string_view style, std::string_view tooltip = "");
  /// One of marker_shapes shapes, `radius` in pixels.
  void marker(std::size_t shape, double x, double y, double radius, std::string_view style,
              std::string_view tooltip = "");
  void path(const std::vector<std::pair<double, double>>& points, std::string_view style);
  [[nodiscard]] const std::string& body() const { return body_; }

 private:
  void mark(const std::string& element, std::string_view tooltip);
  std::string body_;
};
inline constexpr std::size_t marker_shapes = 8;

/// Classes for text (dim, strong, mono), lines (axis, grid, ceiling, copy), and per colour k: fill-k, line-k, open-k.
/// Light and dark.
[[nodiscard]] std::string style_sheet();
inline constexpr std::size_t colours = 8;
/// "fill-3": a class with its colour; beyond the last colour they come again.
[[nodiscard]] std::string colour_class(std::string_view kind, std::size_t k);

/// Pixels that a text of this size takes at most, in any usual sans-serif font.
[[nodiscard]] double text_width(std::string_view text, double size = 12);

/// Values on a line of pixels.
class Axis {
 public:
  Axis(double low, double high, double from, double to, bool logarithmic);
  /// Logarithmic, over all values (those that are not positive left out) and a little more on both sides.
  static Axis around(const std::vector<double>& values, double from, double to);
  [[nodiscard]] double at(double value) const;
  [[nodiscard]] double low() const { return low_; }
  [[nodiscard]] double high() const { return high_; }
  [[nodiscard]] double from() const { return from_; }
  [[nodiscard]] double to() const { return to_; }
  /// Round values within, so few that each label has `room` pixels.
  [[nodiscard]] std::vector<double> ticks(double room) const;

 private:
  double low_, high_, from_, to_;
  bool logarithmic_;
};

/// The grid and labels of both axes and their names; `label` turns a tick into text.
using Label = std::string (*)(double);
void draw_axes(Svg& svg, const Axis& x, const Axis& y, std::string_view x_name, std::string_view y_name, Label x_label,
               Label y_label);
/// The same for x alone, over a field from `top` to `bottom`.
void draw_x_axis(Svg& svg, const Axis& x, double top, double bottom, std::string_view name, Label label);

// Labels.
[[nodiscard]] std::string plain(double value);    ///< "0.5", "20", "1e+06"
[[nodiscard]] std::string seconds(double value);  ///< "1.5 ms"
[[nodiscard]] std::string bytes(double value);    ///< "4 GB"
[[nodiscard]] std::string count(double value);    ///< "16k"

}  // namespace interflect::cli
