#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace interflect {

/// For each row r < `rows`: y[c][first + r] = Σ_j elements[r * stride + j] * x[c][j] in double, over all of the stride,
/// a multiple of 16: x has as many. The same bits for every number of threads and however rows are cut into calls.
void exact_rows(const float* elements, std::uint32_t rows, std::size_t stride,
                const std::vector<std::vector<double>>& x, std::uint32_t first, std::vector<std::vector<double>>& y);

}  // namespace interflect
