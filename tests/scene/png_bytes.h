#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace interflect::testing {

/// A PNG of 8-bit (or 16-bit, big-endian) RGB without compression, written from the specification (ISO/IEC 15948, RFC
/// 1950 and 1951), so that a test can also make one that lies.
class PngBytes {
 public:
  /// `rgb`: 3 * width * height * bits / 8 bytes, less than 64 KiB with a byte more per row.
  static std::string make(std::uint32_t width, std::uint32_t height, std::string_view rgb, unsigned bits = 8) {
    const std::size_t row = std::size_t{3} * width * bits / 8;
    std::string header = be32(width) + be32(height) + static_cast<char>(bits);
    header += std::string("\x02\x00\x00\x00", 4);
    std::string rows;
    for (std::size_t y = 0; y < height && y * row < rgb.size(); ++y) {
      rows += '\0';  // no filter
      rows += rgb.substr(y * row, row);
    }
    std::string data("\x78\x01\x01", 3);  // zlib; one final stored block
    const auto n = static_cast<std::uint16_t>(rows.size());
    for (const unsigned v : {unsigned(n), ~unsigned(n)}) {
      data += static_cast<char>(v & 0xff);
      data += static_cast<char>(v >> 8 & 0xff);
    }
    data += rows + be32(adler32(rows));
    return std::string("\x89PNG\r\n\x1a\n", 8) + chunk("IHDR", header) + chunk("IDAT", data) + chunk("IEND", "");
  }

 private:
  static std::string be32(std::uint32_t v) {
    return {static_cast<char>(v >> 24), static_cast<char>(v >> 16), static_cast<char>(v >> 8), static_cast<char>(v)};
  }
  static std::string chunk(std::string type, std::string_view data) {
    type += data;
    std::uint32_t crc = 0xffffffff;
    for (const char c : type) {
      crc ^= static_cast<unsigned char>(c);
      for (int k = 0; k < 8; ++k) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xedb88320 : 0);
    }
    return be32(static_cast<std::uint32_t>(data.size())) + type + be32(~crc);
  }
  static std::uint32_t adler32(std::string_view text) {
    std::uint32_t a = 1, b = 0;
    for (const char c : text) {
      a = (a + static_cast<unsigned char>(c)) % 65521;
      b = (b + a) % 65521;
    }
    return b << 16 | a;
  }
};

}  // namespace interflect::testing
