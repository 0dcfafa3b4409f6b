#pragma once

#include <cstdint>

// The argument blocks of the kernels: plain structs of 32-bit values, the same bytes in every language.
// kernels/README.md gives each kernel's reference loop and buffers.

namespace interflect {

/// matvec: y[c * vector_stride + first + r] = Σ_j f[r * row_stride + j] * x[c * vector_stride + j] for r < rows, j < n.
/// Buffers: f (one panel), x, y. Macro COLUMNS: how many c.
struct MatvecArguments {
  std::uint32_t n = 0;              ///< columns of F
  std::uint32_t first = 0;          ///< the panel's first row
  std::uint32_t rows = 0;           ///< rows in the panel
  std::uint32_t row_stride = 0;     ///< elements from one row of F to the next, a multiple of 16
  std::uint32_t vector_stride = 0;  ///< elements from one column of x or y to the next, a multiple of 16
};

/// read and copy, which measure a device's bandwidth: over `lines` cache lines of 16 floats each.
struct StreamArguments {
  std::uint32_t lines = 0;
};

}  // namespace interflect
