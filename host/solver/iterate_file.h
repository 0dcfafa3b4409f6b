#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "interflect/solver/iterate.h"
#include "interflect/solver/solver.h"

// An iterate as a file: docs/checkpoint.md states every byte.

namespace interflect {

/// The problem that an iterate belongs to.
struct IterateKey {
  std::uint32_t patches = 0, columns = 0;
  Method method = Method::cg;
  std::array<std::uint64_t, 2> geometry{};       ///< of the patches' corners
  std::uint64_t reflectance = 0, emittance = 0;  ///< of the columns' bits
  /// 0: up to a tolerance, whatever made F. Else of everything that K iterations depend on: an iterate of one such
  /// solve is no step of another, nor one that has been corrected towards a tolerance.
  std::uint64_t exactly = 0;
};

/// A hash over the bits of all columns, in order.
[[nodiscard]] std::uint64_t hash_of(const Columns& columns);

/// Writes the file: whole, or as it was before. Throws what AtomicFile throws.
void write_iterate(const std::string& file, const IterateKey& key, const Iterate& iterate);

/// What is in the file. Throws an input Error naming the file when it is no checkpoint, damaged, of another version, or
/// of another problem than `key`; the last one says what differs.
[[nodiscard]] Iterate read_iterate(const std::string& file, const IterateKey& key);

}  // namespace interflect
