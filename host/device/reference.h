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

/// The same with the sums rounded far below a float's: in long double, and at once to a double (y = value).
void matvec_exact(const MatvecArguments& arguments, std::uint32_t columns, std::span<const float> f,
                  std::span<const float> x, std::span<Sum> y);

/// F = S (factor ∘ d) of a panel without gaps, and what close_rows says of its rows.
struct Row {
  float low = 0, high = 0;
  std::uint32_t count = 0;
};
void close_rows(const MatvecArguments& arguments, std::span<const float> s, std::span<const float> d,
                std::span<const float> factor, std::span<double> f, std::span<Row> rows);

}  // namespace interflect::reference
