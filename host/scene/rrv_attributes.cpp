#include "interflect/scene/rrv_attributes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "interflect/scene/scene_limits.h"

namespace interflect::rrv {

namespace {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view blank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(blank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(blank) - first + 1);
}

/// A finite number that takes up the whole text.
std::optional<double> parse_number(std::string_view text) {
  text = trimmed(text);
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  double value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failed != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// The length of the UTF-8 sequence at the start of the text, or 0.
std::size_t sequence_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  const std::size_t length = lead < 0x80   ? 1
                             : lead < 0xc2 ? 0
                             : lead < 0xe0 ? 2
                             : lead < 0xf0 ? 3
                             : lead < 0xf5 ? 4
                                           : 0;
  if (length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
  }
  if (length > 2) {  // overlong forms, surrogates, beyond U+10FFFF
    const unsigned char next = byte(1);
    if ((lead == 0xe0 && next < 0xa0) || (lead == 0xed && next > 0x9f) || (lead == 0xf0 && next < 0x90) ||
        (lead == 0xf4 && next > 0x8f)) {
      return 0;
    }
  }
  return length;
}

}  // namespace

Source::Source(const std::string& text, std::string file) : file_(std::move(file)) {
  for (std::size_t i = text.find('\n'); i != std::string::npos; i = text.find('\n', i + 1)) {
    newlines_.push_back(static_cast<std::ptrdiff_t>(i));
  }
}

std::uint32_t Source::line_at(std::ptrdiff_t offset) const {
  if (offset < 0) return 0;
  const auto before = std::lower_bound(newlines_.begin(), newlines_.end(), offset) - newlines_.begin();
  return static_cast<std::uint32_t>(before + 1);
}

Error Source::error(pugi::xml_node node, std::string_view cause) const {
  return input_error(file_, line(node), cause);
}

void Source::warn(pugi::xml_node node, std::string_view text) {
  if (warnings_.size() >= max_scene_warnings) {
    ++more_warnings_;
    return;
  }
  warnings_.emplace_back(input_error(file_, line(node), text).what());
}

std::vector<std::string> Source::warnings() const {
  std::vector<std::string> all = warnings_;
  if (more_warnings_ > 0) all.push_back(fmt::format("{}: and {} more warnings", file_, more_warnings_));
  return all;
}

double number(const Source& source, pugi::xml_node node, const char* attribute, std::optional<double> fallback) {
  const pugi::xml_attribute found = node.attribute(attribute);
  if (!found) {
    if (fallback) return *fallback;
    throw source.error(node, fmt::format("<{}> has no attribute '{}'", node.name(), attribute));
  }
  const std::optional<double> value = parse_number(found.value());
  if (!value) {
    throw source.error(node,
                       fmt::format("<{}> {}: '{}' is not a finite number", node.name(), attribute, found.value()));
  }
  return *value;
}

std::optional<Vec3> triple(const Source& source, pugi::xml_node node, const char* attribute) {
  const pugi::xml_attribute found = node.attribute(attribute);
  if (!found) return std::nullopt;
  std::array<double, 3> values{};
  std::string_view rest = found.value();
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t comma = rest.find(',');
    const std::optional<double> value = parse_number(rest.substr(0, comma));
    if (!value || (i < 2) != (comma != std::string_view::npos)) {
      throw source.error(node, fmt::format("<{}> {}: '{}' is not three finite numbers separated by commas", node.name(),
                                           attribute, found.value()));
    }
    values[i] = *value;
    rest.remove_prefix(std::min(rest.size(), comma == std::string_view::npos ? rest.size() : comma + 1));
  }
  return Vec3{values[0], values[1], values[2]};
}

std::string name(pugi::xml_node node) {
  const std::string_view text = node.attribute("name").value();
  std::string clean;
  for (std::size_t i = 0; i < text.size() && clean.size() + 4 <= max_scene_name;) {
    const std::size_t length = sequence_length(text.substr(i));
    clean += length == 0 ? std::string_view("?") : text.substr(i, length);
    i += std::max<std::size_t>(1, length);
  }
  return clean;
}

}  // namespace interflect::rrv
