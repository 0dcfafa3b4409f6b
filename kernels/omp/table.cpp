#include "omp/table.h"

#include <fmt/format.h>

#include "interflect/device/kernel_arguments.h"

namespace interflect::omp {

std::span<const TableLine> kernel_table() {
  static const std::vector<TableLine> lines = {
      {"matvec", &matvec, "rrw", sizeof(MatvecArguments), {{"COLUMNS", 1, 24}}},
  };
  return lines;
}

void Launch::refuse_size(std::size_t index, std::uint64_t bytes, std::string_view what) const {
  throw KernelRefusal{
      fmt::format("buffer {} ({}) holds {} bytes, {} are needed", index, what, buffers[index].size(), bytes)};
}

}  // namespace interflect::omp
