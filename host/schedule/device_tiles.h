#pragma once

#include <cstdint>
#include <vector>

#include "interflect/formfactor/blockers.h"
#include "interflect/formfactor/patch_table.h"

namespace interflect {

/// A tile of 32 x 32 pairs as the assembly kernels read it (kernels/README.md).
struct DeviceTile {
  std::uint32_t row = 0;      ///< block of the rows; the highest bit: rays are needed
  std::uint32_t column = 0;   ///< block of the columns, not before the row's
  std::uint32_t rows = 0;     ///< bit k: patch k of the row block can see something of the column block
  std::uint32_t columns = 0;  ///< likewise
};

/// The tiles (r, c), first <= r < end, c >= r, in which a pair may see each other, by rows: whole blocks are culled by
/// plane tests. Rays are needed where anything but the two blocks' own planes lies in the shaft between them.
[[nodiscard]] std::vector<DeviceTile> device_tiles(const PatchTable& patches, const Blockers& blockers, double lift,
                                                   std::uint32_t first, std::uint32_t end);

/// The patches as the kernels read them: assembly::patch_words words each, coordinates relative to a centroid that is
/// given in two parts, padded to whole blocks with patches that face nothing; the words of the samples for the seed.
[[nodiscard]] std::vector<std::uint32_t> device_patches(const PatchTable& patches, std::uint64_t seed);

}  // namespace interflect
