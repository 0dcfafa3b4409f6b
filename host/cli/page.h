#pragma once

#include "interflect/output/html.h"
#include "report.h"

namespace interflect::cli {

/// What a page says of a solve: the scene's name, camera and materials, and the statistics that `solve` prints.
[[nodiscard]] PageOptions page_options(const SolveSummary& summary);

/// How many bounces a page shows one by one: a dozen (with them more than 95 % of the light in most rooms), fewer where
/// they would make the page too large; none where there is no room for one.
[[nodiscard]] std::optional<std::uint32_t> bounces_for_page(std::size_t patches, std::size_t groups);

}  // namespace interflect::cli
