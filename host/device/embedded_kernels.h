#pragma once

#include <span>
#include <string_view>

namespace interflect {

/// A file of kernels/, as it was when the library was built.
struct EmbeddedKernel {
  std::string_view path;  ///< "cl/matvec.cl"
  std::string_view text;
};
/// Defined in a file that cmake/embed_kernels.cmake writes at build time.
[[nodiscard]] std::span<const EmbeddedKernel> embedded_kernels();
/// Of all files of kernels/omp/, which are compiled with the library.
[[nodiscard]] std::string_view openmp_kernels_hash();

}  // namespace interflect
