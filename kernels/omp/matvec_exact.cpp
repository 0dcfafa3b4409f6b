// y = F x as pairs hi + lo of floats, for one panel and all columns. Contract and error bound: kernels/README.md.
//
// A processor has doubles: every product is exact and every sum is rounded to 53 bits, 16 of them per row and column
// side by side; the result is then cut into hi and lo. Memory traffic of a launch: F once from memory for up to three
// columns, then from cache; x, widened, 8 * n * columns bytes from cache for each row.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

namespace interflect::omp {

namespace {

constexpr std::size_t lanes = 16;

double dot(const float* f, const double* x, std::size_t n) {
  double sums[lanes] = {};
  std::size_t j = 0;
  for (; j + lanes <= n; j += lanes) {
#pragma omp simd
    for (std::size_t lane = 0; lane < lanes; ++lane) sums[lane] += static_cast<double>(f[j + lane]) * x[j + lane];
  }
  for (std::size_t lane = 0; j < n; ++j, ++lane) sums[lane] += static_cast<double>(f[j]) * x[j];
  for (std::size_t width = lanes / 2; width > 0; width /= 2) {
    for (std::size_t lane = 0; lane < width; ++lane) sums[lane] += sums[lane + width];
  }
  return sums[0];
}

}  // namespace

void matvec_exact(const Launch& launch) {
  const auto a = launch.arguments<MatvecArguments>();
  const auto columns = static_cast<std::size_t>(launch.macro("COLUMNS"));
  const float* f = launch.floats(0);
  const float* x = launch.floats(1);
  float* y = launch.floats(2) + a.first;
  std::vector<double> wide(columns * a.n);
  for (std::size_t c = 0; c < columns; ++c) {
    std::copy_n(x + c * a.vector_stride, a.n, wide.begin() + static_cast<std::ptrdiff_t>(c * a.n));
  }
  const auto rows = static_cast<std::int64_t>(a.rows);
#pragma omp parallel for schedule(static)
  for (std::int64_t k = 0; k < rows; ++k) {
    const auto r = static_cast<std::size_t>(k);
    for (std::size_t c = 0; c < columns; ++c) {
      const double sum = dot(f + r * a.row_stride, wide.data() + c * a.n, a.n);
      const auto hi = static_cast<float>(sum);
      y[c * a.vector_stride + r] = hi;
      y[(columns + c) * a.vector_stride + r] = static_cast<float>(sum - static_cast<double>(hi));
    }
  }
}

}  // namespace interflect::omp
