#pragma once

#include <cstdint>
#include <span>

#include "interflect/device/kernel_arguments.h"

// What the kernels compute, as serial loops in double that can be checked by eye. kernels/README.md gives the same
// loops.

namespace interflect::reference {

/// A result in double, and the sum of the absolute values of what went into it, to which its error is relative.
struct Sum {
  double value = 0;
  double magnitude = 0;
};

/// y[c * rows + r] = Σ_{j < n} f[r * row_stride + j] * x[c * vector_stride + j] for c < columns, r < rows: without
/// gaps, whatever arguments.first is.
void matvec(const MatvecArguments& arguments, std::uint32_t columns, std::span<const float> f, std::span<const float> x,
            std::span<Sum> y);

}  // namespace interflect::reference
