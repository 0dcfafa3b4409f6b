#include "interflect/scene/gltf_image.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <span>
#include <string_view>
#include <utility>

#include "interflect/base/error.h"

namespace interflect::gltf {

namespace {

using Bytes = std::span<const unsigned char>;

std::uint32_t big_endian(Bytes bytes, std::size_t at, std::size_t length) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < length; ++i) value = value << 8 | bytes[at + i];
  return value;
}

using Size = std::pair<std::uint32_t, std::uint32_t>;

/// Width and height of a PNG (in its first chunk, IHDR) or a JPEG (in its frame header SOFn); 0 when it is neither.
Size size_in_header(Bytes bytes) {
  constexpr std::string_view png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
  if (bytes.size() >= 24 && std::memcmp(bytes.data(), png.data(), png.size()) == 0) {
    return {big_endian(bytes, 16, 4), big_endian(bytes, 20, 4)};
  }
  if (bytes.size() < 4 || big_endian(bytes, 0, 2) != 0xffd8) return {0, 0};
  std::size_t at = 2;
  while (at + 9 <= bytes.size()) {
    if (bytes[at] != 0xff) return {0, 0};
    const unsigned char marker = bytes[at + 1];
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame) return {big_endian(bytes, at + 7, 2), big_endian(bytes, at + 5, 2)};
    if (marker == 0xff) {
      ++at;  // fill byte
    } else {
      at += 2 + big_endian(bytes, at + 2, 2);
    }
  }
  return {0, 0};
}

float linear(double c) {
  return static_cast<float>(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
}

std::vector<float> transfer_table(std::size_t values) {
  std::vector<float> table(values);
  for (std::size_t i = 0; i < values; ++i) table[i] = linear(static_cast<double>(i) / static_cast<double>(values - 1));
  return table;
}

/// The encoded bytes, in a buffer view or with the image.
Bytes encoded(const Document& document, const tinygltf::Image& image, const std::string& who) {
  const auto& model = document.model;
  if (image.bufferView < 0) {
    if (image.image.empty()) {
      const auto why = document.missing_images.find(image.uri);
      throw input_error(document.file, 0,
                        fmt::format("{} cannot be read: {}", who,
                                    why == document.missing_images.end() ? "no such file" : why->second));
    }
    return image.image;
  }
  const auto& view = model.bufferViews.at(static_cast<std::size_t>(image.bufferView));
  const auto& bytes = model.buffers.at(static_cast<std::size_t>(view.buffer)).data;
  if (view.byteOffset > bytes.size() || view.byteLength > bytes.size() - view.byteOffset) {
    throw input_error(document.file, 0, fmt::format("{} reaches beyond its buffer", who));
  }
  return Bytes(bytes).subspan(view.byteOffset, view.byteLength);
}

}  // namespace

Image decode_image(const Document& document, int index, std::uint64_t& texels_left) {
  const tinygltf::Image& source = document.model.images.at(static_cast<std::size_t>(index));
  const std::string who = fmt::format("image {} ('{}')", index, source.name.empty() ? source.uri : source.name);
  const auto fail = [&](std::string_view cause) {
    return input_error(document.file, 0, fmt::format("{} {}", who, cause));
  };
  const Bytes bytes = encoded(document, source, who);
  const auto [width, height] = size_in_header(bytes);
  if (width == 0 || height == 0) throw fail("is neither PNG nor JPEG");
  const std::uint64_t texels = std::uint64_t{width} * height;
  if (width > 1u << 15 || height > 1u << 15 || texels > texels_left) {
    throw fail(fmt::format("of {} x {} texels is too large (all textures together: at most {}); scale it down", width,
                           height, max_texels));
  }
  texels_left -= texels;
  if (bytes.size() > std::size_t{1} << 30) throw fail("is too long");

  tinygltf::Image decoded;
  std::string error, warning;
  if (!tinygltf::LoadImageData(&decoded, index, &error, &warning, 0, 0, bytes.data(), static_cast<int>(bytes.size()),
                               nullptr)) {
    throw fail("cannot be decoded");
  }
  const std::size_t depth = decoded.bits == 16 ? 2 : 1;
  if (static_cast<std::uint32_t>(decoded.width) != width || static_cast<std::uint32_t>(decoded.height) != height ||
      decoded.component != 4 || decoded.image.size() != texels * 4 * depth) {
    throw fail("decodes to another size than its header says");
  }
  const std::vector<float> table = transfer_table(depth == 2 ? 65536 : 256);
  Image image{width, height, std::vector<float>(3 * texels)};
  for (std::size_t i = 0; i < texels; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      std::uint16_t value = decoded.image[(4 * i + c) * depth];
      if (depth == 2) std::memcpy(&value, decoded.image.data() + (4 * i + c) * 2, 2);
      image.pixels[3 * i + c] = table[value];
    }
  }
  return image;
}

Rgb mean(const Image& image) {
  Rgb sum{};
  for (std::size_t i = 0; i < image.pixels.size(); ++i) sum[i % 3] += static_cast<double>(image.pixels[i]);
  for (double& channel : sum) channel /= static_cast<double>(image.pixels.size()) / 3;
  return sum;
}

}  // namespace interflect::gltf
