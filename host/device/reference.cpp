#include "interflect/device/reference.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace interflect::reference {

void matvec(const MatvecArguments& arguments, std::uint32_t columns, std::span<const float> f, std::span<const float> x,
            std::span<Sum> y) {
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t r = 0; r < arguments.rows; ++r) {
      Sum sum;
      for (std::size_t j = 0; j < arguments.n; ++j) {
        const double product = static_cast<double>(f[r * arguments.row_stride + j]) *
                               static_cast<double>(x[c * arguments.vector_stride + j]);
        sum.value += product;
        sum.magnitude += std::abs(product);
      }
      y[c * arguments.rows + r] = sum;
    }
  }
}

void matvec_exact(const MatvecArguments& arguments, std::uint32_t columns, std::span<const float> f,
                  std::span<const float> x, std::span<Sum> y) {
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t r = 0; r < arguments.rows; ++r) {
      long double value = 0, magnitude = 0;
      for (std::size_t j = 0; j < arguments.n; ++j) {
        const double product = static_cast<double>(f[r * arguments.row_stride + j]) *
                               static_cast<double>(x[c * arguments.vector_stride + j]);  // exact
        value += product;
        magnitude += std::abs(product);
      }
      y[c * arguments.rows + r] = {static_cast<double>(value), static_cast<double>(magnitude)};
    }
  }
}

void close_rows(const MatvecArguments& arguments, std::span<const float> s, std::span<const float> d,
                std::span<const float> factor, std::span<double> f, std::span<Row> rows) {
  for (std::size_t r = 0; r < arguments.rows; ++r) {
    Row& row = rows[r] = {std::numeric_limits<float>::max(), 0, 0};
    for (std::size_t j = 0; j < arguments.n; ++j) {
      const float old = s[r * arguments.row_stride + j];
      f[r * arguments.n + j] =
          static_cast<double>(old) * static_cast<double>(factor[arguments.first + r]) * static_cast<double>(d[j]);
      if (old == 0) continue;
      row = {std::min(row.low, d[j]), std::max(row.high, d[j]), row.count + 1};
    }
  }
}

}  // namespace interflect::reference
