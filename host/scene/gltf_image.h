#pragma once

#include <cstdint>

#include "interflect/scene/gltf_document.h"
#include "interflect/scene/scene.h"

namespace interflect::gltf {

/// Decodes image `index` (PNG or JPEG, 8 or 16 bits a channel) and its sRGB transfer function (IEC 61966-2-1):
/// c / 12.92 up to 0.04045, ((c + 0.055) / 1.055)^2.4 above. Alpha is left out. The size is read from the header and
/// taken from `texels_left` before anything is decoded. Throws an input Error naming the image.
[[nodiscard]] Image decode_image(const Document& document, int index, std::uint64_t& texels_left);

/// All images that a scene uses, decoded, may have this many texels: 768 MiB of floats.
constexpr std::uint64_t max_texels = std::uint64_t{1} << 26;

/// The mean colour of an image.
[[nodiscard]] Rgb mean(const Image& image);

}  // namespace interflect::gltf
