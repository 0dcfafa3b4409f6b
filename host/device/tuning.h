#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/device/device.h"

// The launch shape of the product kernels (matvec, tiles16, sym16), chosen per device by a short search and kept on
// disk. The values that are tried are the candidates of kernel_table.cpp. Everything else only reads what is kept:
// without an entry a kernel runs with default_macros().
//
// Entries lie in $XDG_CACHE_HOME/interflect/tuning under device, driver and a hash of the kernel's sources, for the
// number of columns that a solve has. INTERFLECT_TUNING=off: none is used, none is made. INTERFLECT_CACHE=off: none is
// kept.

namespace interflect {

/// The columns for which kernels are tuned: the channels of a solve. Others run with the defaults.
inline constexpr std::uint32_t tuned_columns = 3;

/// The BLOCK of sym16 on devices other than processors, before any tuning.
inline constexpr std::uint32_t default_block_of_gpus = 256;

/// What a search has found for one kernel.
struct TunedShape {
  std::string kernel;
  Macros standard = {};                   ///< the macros that could be chosen, by default
  Macros chosen = {};                     ///< the same macros, as they were found best; equal where nothing was better
  double gain = 1;                        ///< seconds by default / seconds as chosen: the median of the last comparison
  bool done = true;                       ///< false: the time was up before all candidates had been tried
  std::vector<std::string> refused = {};  ///< a line for each candidate that was faster, but failed its check
};

/// False with INTERFLECT_TUNING=off.
[[nodiscard]] bool tuning_allowed();

/// The macros to launch a product kernel of so many columns with: COLUMNS, default_macros(), and over them what is kept
/// for the device. BLOCK, which the matrix decides, is left out. Throws for an unknown kernel only.
[[nodiscard]] Macros launch_macros(const DeviceInfo& device, std::string_view kernel, std::uint32_t columns);

/// The BLOCK with which sym16 was found fastest for large matrices, as PackedMatrix::Options takes it for n patches: 0,
/// the matrix's own choice, where nothing is kept, for too small an n (under eight blocks), or without a device.
[[nodiscard]] std::uint32_t preferred_block(const DeviceInfo* device, std::uint32_t n);

/// What is kept for a kernel of a device, or null: nothing, damage, another key's, a value that is no candidate.
[[nodiscard]] std::optional<TunedShape> kept_shape(const DeviceInfo& device, std::string_view kernel);
/// Keeps it. Returns why it could not, else an empty text.
[[nodiscard]] std::string keep_shape(const DeviceInfo& device, const TunedShape& shape);
/// Whether keep_shape() would find a place.
[[nodiscard]] bool shapes_can_be_kept();

/// An entry of any device, as it lies on disk.
struct KeptShape {
  std::string backend, name, driver;  ///< as in DeviceInfo
  TunedShape shape;
  std::filesystem::path file;
  [[nodiscard]] bool of(const DeviceInfo& device) const {
    return backend == device.backend && name == device.name && driver == device.driver;
  }
};
/// All that can be read, those for other sources of a kernel too, by device and kernel.
[[nodiscard]] std::vector<KeptShape> kept_shapes();
/// Removes all entries, or those of these devices only; damaged ones go with all. Returns how many files are gone.
/// Throws an input Error when one cannot be removed.
std::size_t forget_shapes(const std::vector<DeviceInfo>* devices = nullptr);

/// The kernels that have something to tune on the device: macros with candidates that its backend's kernel uses.
[[nodiscard]] std::vector<std::string> tunable_kernels(const DeviceInfo& device);
/// The macros of a kernel that can be tuned on the device, with their candidates, the default among them, ascending.
struct TunableMacro {
  std::string name;
  std::vector<int> values;
  int standard = 0;
};
[[nodiscard]] std::vector<TunableMacro> tunable_macros(const DeviceInfo& device, std::string_view kernel);

struct TuningOptions {
  double seconds = 2;                ///< for all that tune() does, compiling included; what has begun is finished
  std::function<double()> now = {};  ///< a clock in seconds; empty: the wall's
  std::uint64_t bytes = 0;           ///< of the matrix that is timed; 0: more than the device's caches hold
};
/// Searches the shape of one kernel, macro by macro, from the default outwards: a candidate is timed in turns with the
/// best so far over a matrix of ones, must be faster by 2 % in the median and in all turns but one, and is then taken
/// only if the kernel passes all its check cases with it. In the end the result must beat the default once more. Throws
/// the device's Errors when the default shape does not run.
[[nodiscard]] TunedShape search_shape(Device& device, std::string_view kernel, const TuningOptions& options = {});

}  // namespace interflect
