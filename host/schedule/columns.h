#pragma once

#include <vector>

namespace interflect {

/// Columns of N values, one column per channel (and light group), each contiguous.
using Columns = std::vector<std::vector<float>>;

}  // namespace interflect
