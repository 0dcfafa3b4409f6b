# cmake -DKERNELS=folder -DOUT=file -P embed_kernels.cmake: the kernels of the GPU languages as C++ string literals.
file(GLOB files RELATIVE ${KERNELS} ${KERNELS}/*/*)
list(SORT files)
# Those of OpenMP are compiled with the library; their hash stands for them.
set(omp ${files})
list(FILTER omp INCLUDE REGEX "^omp/")
list(FILTER files EXCLUDE REGEX "^omp/")
set(omp_hashes "")
foreach(path IN LISTS omp)
  file(SHA256 ${KERNELS}/${path} hash)
  string(APPEND omp_hashes "${path} ${hash}\n")
endforeach()
string(SHA256 omp_hash "${omp_hashes}")
set(lines "")
foreach(path IN LISTS files)
  file(READ ${KERNELS}/${path} text)
  string(LENGTH "${text}" length)
  # Literals of less than 64 KiB are what every compiler must take; a kernel file has a fraction of that.
  if(length GREATER 60000)
    message(FATAL_ERROR "${path} is too long to embed")
  endif()
  string(APPEND lines "    {\"${path}\", R\"kernel(${text})kernel\"},\n")
endforeach()
file(WRITE ${OUT}.new "// Written by cmake/embed_kernels.cmake.
#include \"interflect/device/embedded_kernels.h\"

#include <vector>

namespace interflect {

std::span<const EmbeddedKernel> embedded_kernels() {
  static const std::vector<EmbeddedKernel> kernels = {
${lines}  };
  return kernels;
}

std::string_view openmp_kernels_hash() {
  return \"${omp_hash}\";
}

}  // namespace interflect
")
file(COPY_FILE ${OUT}.new ${OUT} ONLY_IF_DIFFERENT)
