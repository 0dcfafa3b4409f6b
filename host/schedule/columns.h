#pragma once

#include <cstdint>
#include <vector>

namespace interflect {

/// Columns of N values, one column per channel (and light group), each contiguous.
using Columns = std::vector<std::vector<float>>;

/// Columns that the kernels take in one pass over F.
inline constexpr std::uint32_t most_columns = 24;

}  // namespace interflect
