#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace interflect {

/// A text of the page, embedded when the library was built (cmake/embed_page.cmake).
struct PagePart {
  std::string_view name;                  ///< "page.html", "style", "program", "three", "licence"
  std::span<const unsigned char> packed;  ///< by gzip
  std::size_t size = 0;                   ///< of the text
  std::string_view sha256;                ///< of the text, hexadecimal
};

[[nodiscard]] std::span<const PagePart> page_parts();
/// Throws an internal Error for a name that is not there.
[[nodiscard]] const PagePart& page_part(std::string_view name);
/// The text. Throws an internal Error when it is not what was packed.
[[nodiscard]] std::string text_of(const PagePart& part);

}  // namespace interflect
