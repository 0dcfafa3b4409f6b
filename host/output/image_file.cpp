#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/output.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

void check_picture(const Picture& picture) {
  const std::size_t values = std::size_t{3} * picture.width * picture.height;
  if (picture.width == 0 || picture.height == 0 || picture.pixels.size() != values ||
      (!picture.display.empty() && picture.display.size() != values)) {
    throw Error(ErrorKind::internal, "output: a picture whose size does not fit its pixels");
  }
}

/// sRGB bytes; from the samples' own tone-mapped mean when the picture has it for this curve.
std::vector<std::uint8_t> screen_bytes(const Picture& picture, ToneMap tone) {
  std::vector<std::uint8_t> bytes(picture.pixels.size());
  const bool ready = !picture.display.empty() && picture.tone == tone;
#pragma omp parallel for
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    Rgb colour{};
    for (std::size_t c = 0; c < 3; ++c) {
      colour[c] = ready ? static_cast<double>(picture.display[k + c])
                        : picture.exposure * static_cast<double>(picture.pixels[k + c]);
    }
    if (!ready) colour = tone_map(colour, tone);
    for (std::size_t c = 0; c < 3; ++c) bytes[k + c] = srgb_byte(colour[c]);
  }
  return bytes;
}

/// OpenEXR writes here; it goes back to fill in its table of offsets, which a file that only grows does not allow.
class MemoryStream : public Imf::OStream {
 public:
  MemoryStream() : Imf::OStream("memory") {}
  void write(const char text[], int count) override {
    const auto size = static_cast<std::size_t>(count);
    if (bytes_.size() < position_ + size) bytes_.resize(position_ + size);
    std::copy_n(text, size, bytes_.begin() + static_cast<std::ptrdiff_t>(position_));
    position_ += size;
  }
  std::uint64_t tellp() override { return position_; }
  void seekp(std::uint64_t position) override { position_ = position; }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  std::size_t position_ = 0;
};

Imath::half to_half(float value) {
  if (std::isnan(value)) return Imath::half(0.0F);
  return Imath::half(std::clamp(value, -65504.0F, 65504.0F));
}

}  // namespace

void write_png(const Picture& picture, ToneMap tone, const std::filesystem::path& path) {
  check_picture(picture);
  const std::vector<std::uint8_t> bytes = screen_bytes(picture, tone);
  AtomicFile file(path);
  // libpng's simplified interface keeps its own setjmp inside; an 8-bit RGB picture gets the sRGB chunk.
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = picture.width;
  image.height = picture.height;
  image.format = PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::vector<std::byte> encoded(size);
  const int done = png_image_write_to_memory(&image, encoded.data(), &size, 0, bytes.data(), 0, nullptr);
  if (done == 0 || PNG_IMAGE_FAILED(image)) {
    throw Error(ErrorKind::internal,
                fmt::format("{}: libpng: {}", path.string(), static_cast<const char*>(image.message)));
  }
  file.write(std::span(encoded).first(size));
  file.commit();
}

void write_exr(const Picture& picture, const std::filesystem::path& path) {
  check_picture(picture);
  AtomicFile file(path);
  std::vector<Imath::half> halves(picture.pixels.size());
  std::transform(picture.pixels.begin(), picture.pixels.end(), halves.begin(), to_half);
  MemoryStream stream;
  try {
    Imf::Header header(static_cast<int>(picture.width), static_cast<int>(picture.height));
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::addChromaticities(header, Imf::Chromaticities());  // Rec. 709 primaries, white point D65
    Imf::addComments(header,
                     fmt::format("Interflect: linear radiosity; exposure of the screen picture {}", picture.exposure));
    Imf::FrameBuffer frame;
    const std::size_t pixel = 3 * sizeof(Imath::half);
    for (std::size_t c = 0; c < 3; ++c) {
      static constexpr std::array<const char*, 3> names{"R", "G", "B"};
      header.channels().insert(names[c], Imf::Channel(Imf::HALF));
      frame.insert(names[c],
                   Imf::Slice(Imf::HALF, reinterpret_cast<char*>(halves.data() + c), pixel, pixel * picture.width));
    }
    Imf::OutputFile exr(stream, header);
    exr.setFrameBuffer(frame);
    exr.writePixels(static_cast<int>(picture.height));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(ErrorKind::internal, fmt::format("{}: OpenEXR: {}", path.string(), error.what()));
  }
  file.write(stream.bytes());
  file.commit();
}

}  // namespace interflect
