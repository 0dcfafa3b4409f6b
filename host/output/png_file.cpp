#include "interflect/output/png_file.h"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <new>

#include "interflect/base/error.h"

namespace interflect {

namespace {

/// What libpng's callbacks see. No exception may pass through libpng, and no object with a destructor may live where
/// its longjmp goes over it.
struct Sink {
  std::string out;
  std::array<char, 128> message{};
};

void append(png_structp png, png_bytep bytes, std::size_t count) {
  bool kept = true;
  try {
    static_cast<Sink*>(png_get_io_ptr(png))->out.append(reinterpret_cast<const char*>(bytes), count);
  } catch (const std::bad_alloc&) {
    kept = false;
  }
  if (!kept) png_error(png, "out of memory");
}

void keep_message(png_structp png, png_const_charp message) {
  auto& text = static_cast<Sink*>(png_get_error_ptr(png))->message;
  for (std::size_t k = 0; k + 1 < text.size() && message[k] != '\0'; ++k) text[k] = message[k];
  png_longjmp(png, 1);
}

void ignore_warning(png_structp /*png*/, png_const_charp /*message*/) {}

/// Frees libpng's structures on every way out.
struct Writer {
  png_structp png = nullptr;
  png_infop info = nullptr;
  explicit Writer(Sink& sink)
      : png(png_create_write_struct(PNG_LIBPNG_VER_STRING, &sink, keep_message, ignore_warning)) {
    if (png != nullptr) info = png_create_info_struct(png);
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { png_destroy_write_struct(&png, &info); }
};

/// False when libpng gave up.
bool write(png_structp png, png_infop info, Sink& sink, const PngImage& image) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_write_fn(png, &sink, append, nullptr);
  png_set_IHDR(png, info, image.width, image.height, image.bits, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  png_write_info(png, info);
  const std::size_t row = std::size_t{3} * image.width * static_cast<std::size_t>(image.bits / 8);
  for (std::size_t y = 0; y < image.height; ++y) png_write_row(png, image.bytes.data() + y * row);
  png_write_end(png, info);
  return true;
}

}  // namespace

std::string encode_png(const PngImage& image) {
  const std::size_t values = std::size_t{3} * image.width * image.height;
  if (image.bytes.size() != values * static_cast<std::size_t>(image.bits) / 8) {
    throw Error(ErrorKind::internal, "output: a PNG image whose size does not fit its bytes");
  }
  Sink sink;
  const Writer writer(sink);
  if (writer.info == nullptr) throw std::bad_alloc();
  if (!write(writer.png, writer.info, sink, image)) {
    throw Error(ErrorKind::internal, fmt::format("libpng: {}", sink.message.data()));
  }
  return std::move(sink.out);
}

}  // namespace interflect
