#include "interflect/scene/png_texture.h"

#include <fmt/format.h>
#include <png.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr std::string_view signature("\x89PNG\r\n\x1a\n", 8);

std::uint32_t big_endian(std::string_view bytes) {
  std::uint32_t value = 0;
  for (const char c : bytes.substr(0, 4)) value = value << 8 | static_cast<unsigned char>(c);
  return value;
}

/// Compares the size in the header, which is the first chunk, with what deflate can pack into the file: at most 1032
/// bytes per byte.
void require_plausible(std::string_view bytes, const std::string& file) {
  constexpr std::size_t header_end = 8 + 8 + 13;
  if (bytes.size() < header_end || bytes.substr(12, 4) != "IHDR") throw input_error(file, 0, "a damaged PNG file");
  const std::uint64_t width = big_endian(bytes.substr(16)), height = big_endian(bytes.substr(20));
  constexpr std::array<unsigned, 7> channels_of_type{1, 0, 3, 1, 2, 0, 4};
  const auto depth = static_cast<unsigned char>(bytes[24]), type = static_cast<unsigned char>(bytes[25]);
  const unsigned channels = type < channels_of_type.size() ? channels_of_type[type] : 0;
  constexpr std::uint64_t most_pixels = std::uint64_t{1} << 26;
  if (width == 0 || height == 0 || channels == 0) throw input_error(file, 0, "a damaged PNG file");
  if (width > most_pixels || height > most_pixels / width) {
    throw input_error(file, 0, fmt::format("a PNG of {} x {} pixels; at most 2^26 are supported", width, height));
  }
  const std::uint64_t raw = height * ((width * depth * channels + 7) / 8);
  if (raw > 1032 * std::uint64_t{bytes.size()}) throw input_error(file, 0, "a truncated PNG file");
}

/// IEC 61966-2-1: the linear value of each sRGB byte.
std::array<float, 256> srgb_table() {
  std::array<float, 256> table{};
  for (std::size_t i = 0; i < table.size(); ++i) {
    const double v = static_cast<double>(i) / 255;
    table[i] = static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
  }
  return table;
}

/// libpng's reader, freed on every way out.
struct Reader {
  png_image image{};
  Reader() { image.version = PNG_IMAGE_VERSION; }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_image_free(&image); }
};

}  // namespace

bool is_png(std::string_view bytes) {
  return bytes.starts_with(signature);
}

Image decode_png(std::string_view bytes, const std::string& file) {
  require_plausible(bytes, file);
  Reader reader;
  const auto fail = [&] { throw input_error(file, 0, fmt::format("a damaged PNG file: {}", reader.image.message)); };
  if (png_image_begin_read_from_memory(&reader.image, bytes.data(), bytes.size()) == 0) fail();
  reader.image.format = PNG_FORMAT_RGBA;  // 8-bit sRGB; alpha kept apart, or libpng would mix in a background
  std::vector<png_byte> pixels(PNG_IMAGE_SIZE(reader.image));
  if (png_image_finish_read(&reader.image, nullptr, pixels.data(), 0, nullptr) == 0) fail();

  static const std::array<float, 256> linear = srgb_table();
  Image out{reader.image.width, reader.image.height, {}};
  out.pixels.reserve(pixels.size() / 4 * 3);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (i % 4 != 3) out.pixels.push_back(linear[pixels[i]]);
  }
  return out;
}

}  // namespace interflect
