#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

namespace interflect::omp {

void matvec(const Launch& launch) {
  const auto a = launch.arguments<MatvecArguments>();
  const auto columns = static_cast<std::uint64_t>(launch.macro("COLUMNS"));
  const auto* f = launch.elements<const float>(0, std::uint64_t{a.rows} * a.row_stride, "f");
  const auto* x = launch.elements<const float>(1, (columns - 1) * a.vector_stride + a.n, "x");
  auto* y = launch.elements<float>(2, (columns - 1) * a.vector_stride + a.first + a.rows, "y");
#pragma omp parallel for schedule(static)
  for (std::uint32_t r = 0; r < a.rows; ++r) {
    for (std::uint64_t c = 0; c < columns; ++c) {
      const float* row = f + std::uint64_t{r} * a.row_stride;
      const float* column = x + c * a.vector_stride;
      float sum = 0;
#pragma omp simd reduction(+ : sum)
      for (std::uint32_t j = 0; j < a.n; ++j) sum += row[j] * column[j];
      y[c * a.vector_stride + a.first + r] = sum;
    }
  }
}

}  // namespace interflect::omp
