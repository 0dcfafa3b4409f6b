#include "interflect/device/kernel_table.h"

#include <fmt/format.h>

#include <algorithm>

#include "interflect/base/error.h"
#include "interflect/device/kernel_arguments.h"

namespace interflect {

namespace {

void demand(bool holds, std::string_view cause) {
  if (!holds) throw std::string(cause);
}

std::uint64_t ceil_div(std::uint64_t a, std::uint64_t b) {
  return (a + b - 1) / b;
}

BufferSizes copy_needs(const LaunchShape& launch) {
  const std::uint64_t lines = launch.arguments<StreamArguments>().lines;
  const std::uint64_t floats = lines * 16;
  demand(ceil_div(lines, launch.groups) <= largest_n / 16, "more than 65536 lines for a work-group");
  return {floats, floats};
}

BufferSizes read_needs(const LaunchShape& launch) {
  const std::uint64_t lines = launch.arguments<StreamArguments>().lines;
  demand(ceil_div(lines, launch.groups) <= largest_n / 16, "more than 65536 lines for a work-group");
  return {lines * 16, launch.groups};
}

BufferSizes matvec_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<MatvecArguments>();
  demand(a.row_stride % 16 == 0 && a.vector_stride % 16 == 0, "a stride is not a multiple of 16");
  demand(a.n <= a.row_stride && a.n <= a.vector_stride, "n is larger than a stride");
  demand(a.n <= largest_n, "n is larger than 1048576");
  demand(std::uint64_t{a.first} + a.rows <= a.vector_stride, "the panel's rows end behind the vector");
  demand(std::uint64_t{launch.groups} * static_cast<std::uint64_t>(launch.macro("ROWS")) >= a.rows,
         "the work-groups do not cover the panel's rows");
  const std::uint64_t columns = static_cast<std::uint64_t>(launch.macro("COLUMNS")) * a.vector_stride;
  return {std::uint64_t{a.rows} * a.row_stride, columns, columns - a.vector_stride + a.first + a.rows};
}

/// What matvec_exact and close_rows share: a panel, and groups of panel_group rows.
MatvecArguments panel_of(const LaunchShape& launch) {
  const auto a = launch.arguments<MatvecArguments>();
  demand(a.row_stride % 16 == 0 && a.vector_stride % 16 == 0, "a stride is not a multiple of 16");
  demand(a.n <= a.row_stride && a.n <= a.vector_stride, "n is larger than a stride");
  demand(a.n <= largest_n, "n is larger than 1048576");
  demand(std::uint64_t{a.first} + a.rows <= a.vector_stride, "the panel's rows end behind the vector");
  demand(std::uint64_t{launch.groups} * panel_group >= a.rows, "the work-groups do not cover the panel's rows");
  return a;
}

BufferSizes matvec_exact_needs(const LaunchShape& launch) {
  const MatvecArguments a = panel_of(launch);
  const std::uint64_t columns = static_cast<std::uint64_t>(launch.macro("COLUMNS")) * a.vector_stride;
  return {std::uint64_t{a.rows} * a.row_stride, columns, 2 * columns - a.vector_stride + a.first + a.rows};
}

BufferSizes close_rows_needs(const LaunchShape& launch) {
  const MatvecArguments a = panel_of(launch);
  const std::uint64_t end = std::uint64_t{a.first} + a.rows;
  return {std::uint64_t{a.rows} * a.row_stride, a.vector_stride, end, 2 * std::uint64_t{a.vector_stride} + end};
}

BufferSizes tiles16_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<TileArguments>();
  demand(a.vector_stride % 16 == 0 && a.n <= a.vector_stride, "n is larger than the stride, or that no multiple of 16");
  demand(a.n <= largest_n, "n is larger than 1048576");
  demand(a.first % tile_rows == 0 && a.first < a.n && a.strips > 0 && a.strips <= ceil_div(a.n - a.first, tile_rows),
         "the strips do not lie in F");
  demand(std::uint64_t{launch.groups} * static_cast<std::uint64_t>(launch.macro("STRIPS")) >= a.strips,
         "the work-groups do not cover the strips");
  const std::uint64_t columns = static_cast<std::uint64_t>(launch.macro("COLUMNS")) * a.vector_stride;
  const std::uint64_t end = std::min<std::uint64_t>(a.n, a.first + std::uint64_t{a.strips} * tile_rows);
  return {std::uint64_t{a.tiles} * tile_elements / 2, std::uint64_t{a.strips} + 1 + a.tiles, columns, end,
          columns - a.vector_stride + end};
}

/// The partial sums of sym16: block_rows^2 slots of `columns` x `block` floats.
std::uint64_t partial_floats(std::uint64_t block_rows, std::uint64_t columns, std::uint64_t block) {
  return block_rows * block_rows * columns * block;
}

BufferSizes sym16_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<SymmetricArguments>();
  const auto block = static_cast<std::uint64_t>(launch.macro("BLOCK"));
  const auto columns = static_cast<std::uint64_t>(launch.macro("COLUMNS"));
  demand(a.vector_stride % 16 == 0 && a.vector_stride <= largest_n, "the stride is no multiple of 16, or too large");
  demand(block % tile_columns == 0, "BLOCK is not a multiple of 16");
  demand(a.block_rows > 0 && (a.block_rows - 1) * block < a.vector_stride, "the blocks do not lie in F");
  demand(a.blocks > 0 && launch.groups == a.blocks, "a work-group for each block is needed");
  return {std::uint64_t{a.tiles} * tile_elements / 2,
          std::uint64_t{a.blocks} * 4 + std::uint64_t{a.strips} * 2 + 1 + a.tiles, columns * a.vector_stride,
          partial_floats(a.block_rows, columns, block)};
}

/// All vector kernels: `Vectors` of them, then the sums buffer.
template <std::size_t Vectors>
BufferSizes vector_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<VectorArguments>();
  demand(a.columns > 0 && a.n > 0 && a.n <= a.vector_stride && a.vector_stride % 16 == 0 &&
             a.blocks == ceil_div(a.n, reduction_block),
         "the argument block does not describe vectors");
  demand(a.n <= largest_n, "n is larger than 1048576");
  const std::uint64_t items = std::uint64_t{a.columns} * a.blocks;
  demand(std::uint64_t{launch.groups} * a.blocks_per_group >= items, "the work-groups do not cover the vectors");
  static_assert(Vectors < most_buffers);
  BufferSizes sizes{};
  for (std::size_t k = 0; k < Vectors; ++k) sizes[k] = (std::uint64_t{a.columns} - 1) * a.vector_stride + a.n;
  sizes[Vectors] = sums_size(a.columns, a.blocks);
  return sizes;
}

/// With a set of sums in `option` and, for reduce, a slot.
template <std::size_t Vectors>
BufferSizes set_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<VectorArguments>();
  demand(a.option < sum_sets && a.slot < scalar_slots, "no such set of sums or slot");
  return vector_needs<Vectors>(launch);
}

/// Vectors and no sums buffer: scale, and sym16_fold, whose first is that of the partial sums.
BufferSizes scale_needs(const LaunchShape& launch) {
  const BufferSizes sizes = vector_needs<2>(launch);
  return {sizes[0], launch.arguments<VectorArguments>().n, sizes[0]};
}

BufferSizes sym16_fold_needs(const LaunchShape& launch) {
  const BufferSizes sizes = scale_needs(launch);
  const auto a = launch.arguments<VectorArguments>();
  const std::uint64_t block = a.option, block_rows = a.slot;
  demand(block > 0 && block % tile_columns == 0 && block_rows == ceil_div(a.n, block), "the blocks are not those of F");
  return {partial_floats(block_rows, a.columns, block), sizes[1], sizes[2]};
}

BufferSizes shadow_rays_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<ShadowRayArguments>();
  demand(a.rays > 0 && a.nodes > 0 && a.leaves > 0, "no rays, or no hierarchy");
  demand(a.nodes <= largest_hierarchy && a.leaves <= largest_hierarchy, "more than 134217728 nodes or leaves");
  demand(ceil_div(a.rays, launch.groups) <= rays_for_a_group, "more than 128 rays for a work-group");
  return {std::uint64_t{a.nodes} * 16, std::uint64_t{a.leaves} * 36, std::uint64_t{a.rays} * 8, a.rays};
}

/// Items of an assembly kernel; throws where the launch does not do all of them.
enum class Item { column, listed, pair, ray, piece, row };
template <Item Of>
BufferSizes assembly_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<AssemblyArguments>();
  demand(a.n > 0 && a.n <= largest_n && a.tiles > 0, "no patches or no tiles");
  demand(a.items > 0, "no items");
  demand(a.most_in_pilot <= assembly::most_pilot, "more than 8191 rays in the pilot");
  demand(a.tiles <= 0x7FFFFFFFU / (assembly::sections * assembly::tile_pairs), "too many tiles for a batch");
  const std::uint64_t pairs = std::uint64_t{a.tiles} * assembly::tile_pairs, end = std::uint64_t{a.first} + a.items;
  const std::uint64_t all = Of == Item::column || Of == Item::row ? pairs / assembly::block
                            : Of == Item::piece                   ? std::uint64_t{a.cuts} * assembly::cut_pieces
                            : Of == Item::ray && a.option != 0    ? a.chunks
                                                                  : pairs;
  demand(end <= all, "items behind the last one");
  demand(Of != Item::listed || a.option < 3, "no such list");
  return {ceil_div(a.n, assembly::block) * assembly::block * assembly::patch_words,
          std::uint64_t{a.tiles} * assembly::tile_words, assembly::work_words(a.tiles),
          assembly::extra_words(a.chunks, a.cuts)};
}

BufferSizes tile_rays_needs(const LaunchShape& launch) {
  BufferSizes sizes = assembly_needs<Item::ray>(launch);
  sizes[4] = 16;  // a hierarchy has a node and a leaf at least
  sizes[5] = 36;
  return sizes;
}

BufferSizes tile_store_needs(const LaunchShape& launch) {
  const auto a = launch.arguments<AssemblyArguments>();
  demand(a.panel_rows > 0 && std::uint64_t{a.panel_first} + a.panel_rows <= a.n, "the panel's rows do not lie in S");
  demand(a.panel_stride % 16 == 0 && a.panel_stride >= a.n, "the stride is no multiple of 16, or too small");
  BufferSizes sizes = assembly_needs<Item::pair>(launch);
  sizes[4] = std::uint64_t{a.panel_rows} * a.panel_stride;
  return sizes;
}

}  // namespace

std::span<const KernelLine> kernel_table() {
  constexpr std::size_t stream = sizeof(StreamArguments);
  constexpr std::size_t vectors = sizeof(VectorArguments);
  constexpr std::size_t tiles = sizeof(AssemblyArguments);
  static const std::vector<KernelLine> lines = {
      {"copy", "copy", "rw", stream, {}, &copy_needs},
      {"read", "read", "rw", stream, {{"STREAMS", 1, 8, 0}}, &read_needs},
      {"matvec",
       "matvec",
       "rrw",
       sizeof(MatvecArguments),
       {{"COLUMNS", 1, 24, 0}, {"ROWS", 1, 64, 16, {4, 8, 12, 16, 32, 64}, true}},
       &matvec_needs},
      {"matvec_exact", "matvec_exact", "rrw", sizeof(MatvecArguments), {{"COLUMNS", 1, 24, 0}}, &matvec_exact_needs},
      {"close_rows", "close_rows", "wrrw", sizeof(MatvecArguments), {}, &close_rows_needs},
      {"tiles16",
       "tiles16",
       "rrrrw",
       sizeof(TileArguments),
       {{"COLUMNS", 1, 24, 0},
        {"STRIPS", 1, 64, 1, {1, 2, 4, 8, 16}, true},
        {"PREFETCH", 0, 1024, 128, {0, 64, 128, 192, 256}}},
       &tiles16_needs},
      {"sym16",
       "sym16",
       "rrrw",
       sizeof(SymmetricArguments),
       {{"COLUMNS", 1, 24, 0},
        {"BLOCK", 16, 1024, 0, {128, 256, 512, 1024}},
        {"PREFETCH", 0, 1024, 160, {0, 96, 160, 224, 288}}},
       &sym16_needs},
      {"sym16_fold", "sym16", "rrw", vectors, {}, &sym16_fold_needs},
      {"scale", "scale", "rrw", vectors, {}, &scale_needs},
      {"shadow_rays", "shadow_rays", "rrrw", sizeof(ShadowRayArguments), {}, &shadow_rays_needs},
      {"tile_kinds", "assembly", "rrww", tiles, {}, &assembly_needs<Item::column>},
      {"tile_special", "assembly", "rrww", tiles, {}, &assembly_needs<Item::listed>},
      {"tile_pilot", "assembly", "rrww", tiles, {}, &assembly_needs<Item::pair>},
      {"tile_rays", "assembly", "rrwwrr", tiles, {}, &tile_rays_needs},
      {"tile_shares", "assembly", "rrww", tiles, {}, &assembly_needs<Item::pair>},
      {"tile_mixed", "assembly", "rrww", tiles, {}, &assembly_needs<Item::pair>},
      {"tile_pieces", "assembly", "rrww", tiles, {}, &assembly_needs<Item::piece>},
      {"tile_finish", "assembly", "rrww", tiles, {}, &assembly_needs<Item::row>},
      {"tile_store", "assembly", "rrwww", tiles, {}, &tile_store_needs},
      {"dot", "reduce", "rrw", vectors, {}, &set_needs<2>},
      {"reduce", "reduce", "w", vectors, {}, &set_needs<0>},
      {"axpby", "axpby", "rwr", vectors, {}, &vector_needs<2>},
      {"bounce", "bounce", "rrrwww", vectors, {}, &vector_needs<5>},
      {"cg_product", "cg", "wrrrw", vectors, {}, &vector_needs<4>},
      {"cg_step", "cg", "rrwwwww", vectors, {}, &vector_needs<6>},
      {"bicgstab_product", "bicgstab", "rwrrw", vectors, {}, &vector_needs<4>},
      {"bicgstab_half", "bicgstab", "rww", vectors, {}, &vector_needs<2>},
      {"bicgstab_step", "bicgstab", "rrwwwww", vectors, {}, &vector_needs<6>},
  };
  return lines;
}

Macros default_macros(const DeviceInfo& device, std::string_view name) {
  const auto lines = kernel_table();
  const auto line = std::find_if(lines.begin(), lines.end(), [&](const KernelLine& l) { return l.name == name; });
  if (line == lines.end()) refuse(device.id, fmt::format("kernel {}", name), "unknown kernel");
  Macros macros;
  for (const MacroRange& range : line->macros) {
    if (range.if_missing >= range.smallest) macros.emplace(range.name, range.if_missing);
  }
  if (const auto rows = macros.find("ROWS"); rows != macros.end()) {
    rows->second = static_cast<int>(device.rows_per_group);
  }
  if (const auto strips = macros.find("STRIPS"); strips != macros.end()) {
    strips->second = static_cast<int>(std::max(1U, device.rows_per_group / tile_rows));
  }
  return macros;
}

void refuse(std::string_view device, std::string_view operation, std::string_view cause) {
  throw device_error(device, operation, cause);
}

FoundKernel find_kernel(std::string_view device, std::string_view name, const Macros& macros) {
  const std::string operation = fmt::format("kernel {}", name);
  for (const KernelLine& line : kernel_table()) {
    if (line.name != name) continue;
    FoundKernel found{&line, {}};
    for (const MacroRange& range : line.macros) {
      const auto given = macros.find(std::string(range.name));
      const int value = given == macros.end() ? range.if_missing : given->second;
      if (given == macros.end() && value < range.smallest) {
        refuse(device, operation, fmt::format("macro {} is not given", range.name));
      }
      if (value < range.smallest || value > range.largest) {
        refuse(device, operation,
               fmt::format("macro {} is {}, it must be {} to {}", range.name, value, range.smallest, range.largest));
      }
      found.macros.emplace(range.name, value);
    }
    return found;
  }
  refuse(device, operation, "unknown kernel");
}

void check_range(std::string_view device, const Buffer& buffer, std::size_t offset, std::size_t bytes,
                 std::string_view operation) {
  if (offset > buffer.size() || bytes > buffer.size() - offset) {
    refuse(device, operation, fmt::format("bytes {} to {} of a buffer of {}", offset, offset + bytes, buffer.size()));
  }
  if (operation == "upload" && buffer.read_only()) {
    refuse(device, operation, "the buffer shares memory of the host, read only");
  }
}

void check_launch(const DeviceInfo& device, const KernelLine& line, const Macros& macros, std::uint32_t groups,
                  std::span<Buffer* const> buffers, std::span<const std::byte> arguments, std::string_view label) {
  const auto fail = [&](std::string_view cause) {
    refuse(device.id, fmt::format("launch {} ({})", line.name, label), cause);
  };
  if (buffers.size() != line.access.size()) {
    fail(fmt::format("{} buffers given, {} needed", buffers.size(), line.access.size()));
  }
  if (arguments.size() != line.argument_bytes) {
    fail(fmt::format("an argument block of {} bytes given, {} needed", arguments.size(), line.argument_bytes));
  }
  if (groups == 0) fail("no work-groups");
  if (groups > device.max_groups) fail(fmt::format("{} work-groups, the device takes {}", groups, device.max_groups));
  BufferSizes needed{};
  try {
    needed = line.needed({groups, arguments, &macros});
  } catch (const std::string& cause) {
    fail(cause);
  }
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    if (buffers[i] == nullptr) fail(fmt::format("buffer {} is missing", i));
    if (line.access[i] != 'r' && buffers[i]->read_only()) {
      fail(fmt::format("buffer {} is written, but shares memory of the host, read only", i));
    }
    if (buffers[i]->size() / sizeof(float) < needed[i]) {
      fail(fmt::format("buffer {} holds {} bytes, {} are needed", i, buffers[i]->size(), needed[i] * sizeof(float)));
    }
    for (std::size_t k = 0; k < i; ++k) {
      if (buffers[k] == buffers[i] && (line.access[i] != 'r' || line.access[k] != 'r')) {
        fail(fmt::format("buffers {} and {} are the same, and one is written", k, i));
      }
    }
  }
}

}  // namespace interflect
