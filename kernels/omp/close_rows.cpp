// S to F in place for one panel, and what the rows tell of it. Contract: kernels/README.md.
//
// Memory traffic of a launch: 4 * rows * n bytes read and as many written; d from cache.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "interflect/device/kernel_arguments.h"
#include "omp/table.h"

namespace interflect::omp {

void close_rows(const Launch& launch) {
  const auto a = launch.arguments<MatvecArguments>();
  float* s = launch.floats(0);
  const float* d = launch.floats(1);
  const float* factor = launch.floats(2);
  float* of_rows = launch.floats(3) + a.first;
  const auto rows = static_cast<std::int64_t>(a.rows);
#pragma omp parallel for schedule(static)
  for (std::int64_t r = 0; r < rows; ++r) {
    const auto k = static_cast<std::size_t>(r);
    float* row = s + k * a.row_stride;
    const float by = factor[a.first + k];
    float low = std::numeric_limits<float>::max(), high = 0;
    std::uint32_t count = 0;
#pragma omp simd reduction(min : low) reduction(max : high) reduction(+ : count)
    for (std::uint32_t j = 0; j < a.n; ++j) {
      const float old = row[j], dj = d[j];
      const float least = old != 0 ? dj : std::numeric_limits<float>::max(), most = old != 0 ? dj : 0.0F;
      low = std::min(low, least);
      high = std::max(high, most);
      count += old != 0 ? 1 : 0;
      row[j] = old * (by * dj);
    }
    of_rows[k] = low;
    of_rows[k + a.vector_stride] = high;
    of_rows[k + std::size_t{2} * a.vector_stride] = static_cast<float>(count);
  }
}

}  // namespace interflect::omp
