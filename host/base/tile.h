#pragma once

#include <cstdint>

namespace interflect {

/// A tile of the 16-bit storage formats: 8 rows x 16 columns, row-major, that begins at multiples of these.
inline constexpr std::uint32_t tile_rows = 8, tile_columns = 16, tile_elements = tile_rows * tile_columns;

}  // namespace interflect
