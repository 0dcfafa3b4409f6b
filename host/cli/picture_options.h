#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "interflect/output/output.h"

namespace interflect::cli {

/// What the command line says of a picture, as given.
struct PictureText {
  std::string camera, up = "0,1,0", size = "1280x720", tone = "filmic";
  std::optional<double> exposure;
  std::uint32_t samples = 16;
};
/// --camera, --up, --size, --exposure, --tone, --samples
void add_picture_options(CLI::App& command, PictureText& text);

/// With the scene's camera where none is given. Throws a usage Error for a malformed one.
[[nodiscard]] PictureOptions picture_options(const PictureText& text, const std::optional<Camera>& of_scene);

/// What can be wrong before the work: throws what picture_options() throws, and, where a picture is to be written, a
/// limit Error for one that does not fit the memory.
void check_picture(const PictureText& text, bool written);

}  // namespace interflect::cli
