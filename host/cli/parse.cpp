#include "parse.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>

#include "interflect/base/error.h"

namespace interflect::cli {

std::vector<double> parse_numbers(const std::string& text, const std::string& option) {
  std::vector<double> values;
  const char* at = text.data();
  const char* const end = at + text.size();
  for (;;) {
    double value = 0;
    const auto [next, status] = std::from_chars(at, end, value);
    if (status != std::errc{} || !std::isfinite(value) || (next != end && *next != ',')) {
      throw Error(ErrorKind::usage, fmt::format("{}: '{}' is not numbers between commas", option, text));
    }
    values.push_back(value);
    if (next == end) return values;
    at = next + 1;
  }
}

std::pair<std::uint32_t, std::uint32_t> parse_size(const std::string& text) {
  constexpr std::uint32_t largest = 16384;
  std::uint32_t width = 0, height = 0;
  const char* const end = text.data() + text.size();
  const auto [x, first] = std::from_chars(text.data(), end, width);
  if (first == std::errc{} && x != end && (*x == 'x' || *x == 'X')) {
    const auto [rest, second] = std::from_chars(x + 1, end, height);
    if (second == std::errc{} && rest == end && width >= 1 && height >= 1 && width <= largest && height <= largest) {
      return {width, height};
    }
  }
  throw Error(ErrorKind::usage, fmt::format("--size: '{}' is not WIDTHxHEIGHT, each 1 to {}", text, largest));
}

Camera parse_camera(const std::string& text, const std::string& up) {
  const auto numbers = parse_numbers(text, "--camera");
  const auto upwards = parse_numbers(up, "--up");
  if (numbers.size() != 6 && numbers.size() != 7) {
    throw Error(ErrorKind::usage, fmt::format("--camera: '{}' is not EX,EY,EZ,TX,TY,TZ[,FOV]", text));
  }
  if (upwards.size() != 3) throw Error(ErrorKind::usage, fmt::format("--up: '{}' is not X,Y,Z", up));
  Camera camera;
  camera.eye = {numbers[0], numbers[1], numbers[2]};
  camera.target = {numbers[3], numbers[4], numbers[5]};
  camera.up = {upwards[0], upwards[1], upwards[2]};
  if (numbers.size() == 7) {
    if (!(numbers[6] > 0 && numbers[6] < 179)) {
      throw Error(ErrorKind::usage, fmt::format("--camera: a field of view of {} degrees", numbers[6]));
    }
    camera.vertical_fov = numbers[6] * std::numbers::pi / 180;
  }
  const Vec3 view = camera.target - camera.eye;
  if (!(length(cross(view, camera.up)) > 1e-9 * length(view) * length(camera.up))) {
    throw Error(ErrorKind::usage,
                "--camera: eye, target and up give no view (is the target the eye, or up along the view?)");
  }
  return camera;
}

}  // namespace interflect::cli
