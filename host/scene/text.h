#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "interflect/scene/scene.h"

namespace interflect {

/// A name from a file as it may stand in a message: control characters become '?', a long name is cut.
[[nodiscard]] std::string one_line(std::string_view text);

/// Where a triangle of the scene comes from: "line 12 (object 'table', group 'top')", "triangle 3 of 40" without lines.
[[nodiscard]] std::string place_of(const Scene& scene, std::size_t triangle);

}  // namespace interflect
