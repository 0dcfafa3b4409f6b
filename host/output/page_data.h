#pragma once

#include <string>

#include "interflect/output/html.h"

namespace interflect {

/// What the page's program reads: a description in JSON and the numbers that it points into.
struct PageData {
  std::string description;  ///< JSON; "sections": {name: {type, at, count}} with `at` in bytes of `numbers`
  std::string numbers;      ///< little-endian; every section begins at a multiple of 4 bytes
};

/// See make_page() for what is in it and how exact it is.
[[nodiscard]] PageData page_data(const Solution& solution, const PageOptions& options);

}  // namespace interflect
