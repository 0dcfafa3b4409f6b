# cmake -DKERNELS=folder -DOUT=file -P embed_kernels.cmake: the kernels of the GPU languages as C++ string literals.
file(GLOB files RELATIVE ${KERNELS} ${KERNELS}/*/*)
list(FILTER files EXCLUDE REGEX "^omp/")  # compiled with the library
list(SORT files)
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

}  // namespace interflect
")
file(COPY_FILE ${OUT}.new ${OUT} ONLY_IF_DIFFERENT)
