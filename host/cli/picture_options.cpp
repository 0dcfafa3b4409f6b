#include "picture_options.h"

#include <fmt/format.h>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "parse.h"
#include "validators.h"

namespace interflect::cli {

void add_picture_options(CLI::App& command, PictureText& text) {
  auto* camera = command.add_option("--camera", text.camera, "EX,EY,EZ,TX,TY,TZ[,FOV]: eye, target, vertical degrees");
  command.add_option("--up", text.up, "the camera's up: X,Y,Z")->needs(camera)->capture_default_str();
  command.add_option("--size", text.size, "picture size: WIDTHxHEIGHT")->capture_default_str();
  command.add_option("--exposure", text.exposure, "factor on the radiosity before the tone curve")->check(number(0.0));
  command.add_option("--tone", text.tone, "tone curve: linear, filmic")
      ->check(CLI::IsMember({"linear", "filmic"}))
      ->capture_default_str();
  command.add_option("--samples", text.samples, "samples per pixel")->check(number(0U, 4096U))->capture_default_str();
}

PictureOptions picture_options(const PictureText& text, const std::optional<Camera>& of_scene) {
  PictureOptions picture;
  const auto [width, height] = parse_size(text.size);
  picture.width = width;
  picture.height = height;
  picture.exposure = text.exposure;
  picture.tone = text.tone == "linear" ? ToneMap::linear : ToneMap::filmic;
  picture.samples = text.samples;
  picture.camera = text.camera.empty() ? of_scene : parse_camera(text.camera, text.up);
  return picture;
}

void check_picture(const PictureText& text, bool written) {
  const PictureOptions picture = picture_options(text, std::nullopt);
  if (!written) return;
  // Linear and displayed values in single precision, then the bytes of one file, plain and packed.
  constexpr std::uint64_t bytes_per_pixel = 6 * sizeof(float) + 6 * sizeof(std::uint16_t);
  const std::uint64_t needed = bytes_per_pixel * picture.width * picture.height;
  const std::uint64_t available = available_memory();
  if (needed <= available) return;
  constexpr double mebibyte = 1 << 20;
  throw Error(
      ErrorKind::limit,
      fmt::format("--size {}: the picture needs {:.0f} MiB, and {:.0f} MiB may be used: use a smaller one", text.size,
                  static_cast<double>(needed) / mebibyte, static_cast<double>(available) / mebibyte));
}

}  // namespace interflect::cli
