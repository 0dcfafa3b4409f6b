#include "interflect/device/reference.h"

#include <cmath>
#include <cstddef>

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

}  // namespace interflect::reference
