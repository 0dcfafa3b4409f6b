#pragma once

#include <span>
#include <string_view>

namespace interflect {

/// A text of the page, embedded when the library was built (cmake/embed_page.cmake).
struct PagePart {
  std::string_view name;  ///< "page.html", "style", "program", "three", "licence"
  std::span<const std::string_view> pieces;
  std::string_view sha256;  ///< of the pieces together, hexadecimal
};

/// Throws an internal Error for a name that is not there.
[[nodiscard]] const PagePart& page_part(std::string_view name);
[[nodiscard]] std::span<const PagePart> page_parts();

}  // namespace interflect
