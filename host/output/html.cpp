#include "interflect/output/html.h"

#include <fmt/format.h>

#include <cstdint>
#include <string>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/bytes.h"
#include "interflect/output/page_data.h"
#include "interflect/output/page_parts.h"

namespace interflect {

namespace {

using Write = std::function<void(std::string_view)>;

/// Base64 of RFC 4648, with padding, in pieces of a few hundred KiB.
void write_base64(std::string_view bytes, const Write& write) {
  constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  constexpr std::size_t piece = 3U << 16U;
  std::string out;
  for (std::size_t start = 0; start < bytes.size(); start += piece) {
    const std::string_view part = bytes.substr(start, piece);
    out.clear();
    for (std::size_t i = 0; i < part.size(); i += 3) {
      std::uint32_t word = 0;
      const std::size_t have = std::min<std::size_t>(3, part.size() - i);
      for (std::size_t k = 0; k < 3; ++k) {
        word = word << 8U | (k < have ? static_cast<unsigned char>(part[i + k]) : 0U);
      }
      for (std::size_t k = 0; k < 4; ++k) {
        out += k <= have ? digits[word >> (18 - 6 * k) & 63U] : '=';
      }
    }
    write(out);
  }
}

std::string base64_of_hex(std::string_view hex) {
  std::string bytes, out;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes += static_cast<char>(std::stoi(std::string(hex.substr(i, 2)), nullptr, 16));
  }
  write_base64(bytes, [&](std::string_view text) { out += text; });
  return out;
}

/// What the page may do: run its own two scripts, use its own style, show pictures that it made. Nothing else.
std::string policy(const PageOptions& options) {
  const auto hash = [](const char* name) { return fmt::format("'sha256-{}'", base64_of_hex(page_part(name).sha256)); };
  return fmt::format(
      "default-src 'none'; script-src {} {}; style-src {}; img-src data: blob:; {}base-uri 'none'; form-action 'none'",
      hash("three"), hash("program"), hash("style"), options.served ? "connect-src 'self'; " : "");
}

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : printable_name(text)) {
    switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      default: out += c;
    }
  }
  return out;
}

}  // namespace

void make_page(const Solution& solution, const PageOptions& options, const Write& write) {
  const PageData data = page_data(solution, options);
  constexpr std::size_t largest = std::size_t{3} << 28;  // base64 makes 4 bytes of 3
  if (data.numbers.size() > largest) {
    throw Error(ErrorKind::limit,
                fmt::format("page: {} patches and {} lamps need {} MiB, above the 1 GiB that a browser opens",
                            solution.mesh->size(), solution.lit.size(), data.numbers.size() / 3 * 4 >> 20));
  }
  const std::string outline = text_of(page_part("page.html"));
  // "@NAME@" in the outline stands for what comes here.
  const auto fill = [&](std::string_view name) {
    if (name == "TITLE") return write(escaped(options.title));
    if (name == "POLICY") return write(policy(options));
    if (name == "DESCRIPTION") return write(data.description);
    if (name == "NUMBERS") return write_base64(data.numbers, write);
    if (name == "STYLE") return write(text_of(page_part("style")));
    if (name == "THREE") return write(text_of(page_part("three")));
    if (name == "PROGRAM") return write(text_of(page_part("program")));
    if (name == "LICENCE") return write(text_of(page_part("licence")));
    throw Error(ErrorKind::internal, fmt::format("page: nothing is known of @{}@", name));
  };
  std::string_view rest(outline);
  for (std::size_t start = 0; (start = rest.find('@')) != std::string_view::npos;) {
    write(rest.substr(0, start));
    const std::size_t end = rest.find('@', start + 1);
    fill(rest.substr(start + 1, end - start - 1));
    rest.remove_prefix(end + 1);
  }
  write(rest);
}

void write_html(const Solution& solution, const PageOptions& options, const std::filesystem::path& path) {
  AtomicFile file(path);
  make_page(solution, options, [&](std::string_view text) { file.write(text); });
  file.commit();
}

}  // namespace interflect
