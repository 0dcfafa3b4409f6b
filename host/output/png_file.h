#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace interflect {

/// An RGB image for a PNG file: 8 or 16 bits per channel, most significant byte first, rows from the top, sRGB.
struct PngImage {
  std::uint32_t width = 0, height = 0;
  int bits = 8;
  std::vector<std::uint8_t> bytes;
};

/// The file's bytes, with the sRGB chunk. (libpng's simplified interface writes 16 bits only as linear values, which
/// most readers take for sRGB.) Throws an internal Error with libpng's message.
[[nodiscard]] std::string encode_png(const PngImage& image);

}  // namespace interflect
