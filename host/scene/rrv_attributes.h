#pragma once

#include <cstdint>
#include <optional>
#include <pugixml.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/vec3.h"

namespace interflect::rrv {

/// A text whose byte offsets are turned into line numbers, and the messages that name them.
class Source {
 public:
  Source(const std::string& text, std::string file);

  [[nodiscard]] std::uint32_t line_at(std::ptrdiff_t offset) const;
  [[nodiscard]] std::uint32_t line(pugi::xml_node node) const { return line_at(node.offset_debug()); }
  [[nodiscard]] Error error(pugi::xml_node node, std::string_view cause) const;
  /// Keeps "line N: TEXT", up to max_scene_warnings of them.
  void warn(pugi::xml_node node, std::string_view text);
  /// The warnings, and as the last one how many were left out.
  [[nodiscard]] std::vector<std::string> warnings() const;

 private:
  std::string file_;
  std::vector<std::ptrdiff_t> newlines_;
  std::vector<std::string> warnings_;
  std::size_t more_warnings_ = 0;
};

/// A number attribute; `fallback` where it is missing, an error where there is none.
[[nodiscard]] double number(const Source& source, pugi::xml_node node, const char* attribute,
                            std::optional<double> fallback = std::nullopt);
/// Three numbers separated by commas, or nothing where the attribute is missing.
[[nodiscard]] std::optional<Vec3> triple(const Source& source, pugi::xml_node node, const char* attribute);
/// A name as it can be printed: bytes that are not UTF-8 become '?'.
[[nodiscard]] std::string name(pugi::xml_node node);

}  // namespace interflect::rrv
