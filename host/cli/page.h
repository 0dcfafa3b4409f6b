#pragma once

#include "interflect/output/html.h"
#include "report.h"

namespace interflect::cli {

/// What a page says of a solve: the scene's name, camera and materials, and the statistics that `solve` prints.
[[nodiscard]] PageOptions page_options(const SolveSummary& summary);

}  // namespace interflect::cli
