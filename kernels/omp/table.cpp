#include "omp/table.h"

#include <fmt/format.h>

#include "interflect/device/kernel_arguments.h"

namespace interflect::omp {

std::span<const TableLine> kernel_table() {
  static const std::vector<TableLine> lines = {
      {"copy", &copy, "rw", sizeof(StreamArguments), {}},
      {"matvec", &matvec, "rrw", sizeof(MatvecArguments), {{"COLUMNS", 1, 24}}},
      {"dot", &dot, "rrw", sizeof(VectorArguments), {}},
      {"reduce", &reduce, "w", sizeof(VectorArguments), {}},
      {"axpby", &axpby, "rwr", sizeof(VectorArguments), {}},
      {"bounce", &bounce, "rrrwww", sizeof(VectorArguments), {}},
      {"cg_product", &cg_product, "wrrrw", sizeof(VectorArguments), {}},
      {"cg_step", &cg_step, "rrwwwww", sizeof(VectorArguments), {}},
      {"bicgstab_product", &bicgstab_product, "rwrrw", sizeof(VectorArguments), {}},
      {"bicgstab_half", &bicgstab_half, "rww", sizeof(VectorArguments), {}},
      {"bicgstab_step", &bicgstab_step, "rrwwwww", sizeof(VectorArguments), {}},
      {"read", &read, "rw", sizeof(StreamArguments), {{"STREAMS", 1, 8}}},
  };
  return lines;
}

void Launch::refuse_size(std::size_t index, std::uint64_t bytes, std::string_view what) const {
  throw KernelRefusal{
      fmt::format("buffer {} ({}) holds {} bytes, {} are needed", index, what, buffers[index].size(), bytes)};
}

}  // namespace interflect::omp
