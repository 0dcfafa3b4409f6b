#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "interflect/formfactor/assembly.h"

namespace interflect::cli {

/// {count, worst, patches}: AssemblyReport::moved(), and the largest AssemblyReport::row_change().
[[nodiscard]] nlohmann::ordered_json moved_json(const AssemblyReport& report);

/// {rows, off, worst: [{patch, object, group, centroid, row_sum, deviation, error, escape, back, set_aside, cause,
/// other}]}; null where there is none.
[[nodiscard]] nlohmann::ordered_json certificate_json(const Certificate& certificate);
/// The same in at most six lines: the worst of the rows that are off, or that there are none.
[[nodiscard]] std::string certificate_text(const Certificate& certificate);

}  // namespace interflect::cli
