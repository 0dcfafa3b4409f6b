#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "interflect/device/device.h"
#include "interflect/formfactor/storage.h"

namespace interflect {

/// The storage format of that name; none for "auto". Throws a usage Error for another name.
[[nodiscard]] std::optional<Storage> storage_of(std::string_view name);

/// What `--storage auto` takes for one solve of n patches, whose dense32 matrix is already there, on this device:
///   sym16    where dense32 and the vectors of a solve do not fit into the device's memory;
///            on a processor behind a GPU driver from 4,096 patches on: dense32 would have to be copied (4 n² bytes),
///            and reading it a dozen times costs more than finding and packing a tenth of it;
///   tiled16  where that is so, but the partial sums of sym16 exceed the device's largest buffer;
///   dense32  else: below 4,096 patches F stays in caches and no format is faster; OpenMP uses the host's matrix in
///   place
///            and a GPU reads it at full speed, so that packing, some 1.5 ns an element, would take longer than the ten
///            to twenty products of a solve save.
/// Who solves many times with one F asks for sym16.
[[nodiscard]] Storage choose_storage(std::uint32_t n, const DeviceInfo& device);

/// For devices that work together: dense32 where all of them have room for it together; else sym16, or tiled16 where
/// the partial sums of sym16 exceed a device's largest buffer.
[[nodiscard]] Storage choose_storage(std::uint32_t n, std::span<const DeviceInfo> devices);

/// The block of sym16 for n patches on a device: what tuning has found, for large matrices; else 256 for GPUs, which
/// need hundreds of work-groups and keep a block's vectors in shared memory, and 0, PackedMatrix's own choice, for
/// processors.
[[nodiscard]] std::uint32_t sym16_block(const DeviceInfo& device, std::uint32_t n);

/// Largest difference of a radiosity, relative to the largest radiosity, that a format's rounding may cause.
inline constexpr double largest_rounding_error = 1e-4;

}  // namespace interflect
