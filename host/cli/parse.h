#pragma once

#include <string>
#include <utility>
#include <vector>

#include "interflect/scene/scene.h"

namespace interflect::cli {

/// "X,Y,Z": finite numbers between commas. Throws a usage Error naming `option`.
[[nodiscard]] std::vector<double> parse_numbers(const std::string& text, const std::string& option);
/// "WIDTHxHEIGHT", each 1 to 16384. Throws a usage Error.
[[nodiscard]] std::pair<std::uint32_t, std::uint32_t> parse_size(const std::string& text);
/// "EX,EY,EZ,TX,TY,TZ[,FOV]" with FOV in vertical degrees, and an up direction "X,Y,Z". Throws a usage Error.
[[nodiscard]] Camera parse_camera(const std::string& text, const std::string& up);

}  // namespace interflect::cli
