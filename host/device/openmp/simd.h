#pragma once

#include <string>
#include <string_view>
#include <vector>

// Which of Highway's instruction sets the kernels of kernels/omp/ run with: the best that the machine has, unless
// INTERFLECT_SIMD names a lower one.

namespace interflect::openmp {

/// The instruction sets that this build has code for and this machine can run, best first: "AVX3", "AVX2", "SSE4", ...
[[nodiscard]] std::vector<std::string> simd_targets();

/// The one in use.
[[nodiscard]] std::string simd_target();

/// Makes every later launch of this process use `name`, one of simd_targets(); "" means the best again. Throws a usage
/// Error that lists the valid names for any other. Not while kernels run.
void use_simd_target(std::string_view name);

}  // namespace interflect::openmp
