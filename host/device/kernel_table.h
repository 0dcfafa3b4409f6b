#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "interflect/device/device.h"

// The kernels, said once for all backends: names, files, buffers, argument blocks, macros, and what a launch must hold.
// kernels/README.md is the contract in words. A backend's kernel() begins with find_kernel(), its queue's transfers and
// launches with check_range() and check_launch(), so that a wrong call ends the same way everywhere.
//
// To add a kernel NAME: its argument block goes into kernel_arguments.h, its contract into kernels/README.md, its line
// into kernel_table.cpp, its code into kernels/LANGUAGE/, its check into a check_*.cpp.

namespace interflect {

/// A macro that a kernel takes, and the values it may have.
struct MacroRange {
  std::string_view name;
  int smallest;
  int largest;
  int if_missing;  ///< the value of a macro that is not given; below `smallest`: it must be given
  /// What tuning.h tries, ascending; empty: the macro is not a matter of speed. The result may differ in rounding.
  std::vector<int> candidates = {};
  bool of_groups = false;  ///< how much a work-group takes, which OpenMP ignores
};

/// What a launch asks for, as far as its kernel's line can judge it.
struct LaunchShape {
  std::uint32_t groups = 0;
  std::span<const std::byte> argument_bytes;
  const Macros* macros = nullptr;

  template <class Arguments>
  [[nodiscard]] Arguments arguments() const {
    static_assert(std::is_trivially_copyable_v<Arguments>);
    Arguments block;
    std::memcpy(&block, argument_bytes.data(), sizeof block);  // check_launch() has checked the size
    return block;
  }
  [[nodiscard]] int macro(std::string_view name) const { return macros->at(std::string(name)); }
};

inline constexpr std::size_t most_buffers = 8;  ///< of a kernel
/// Floats for each buffer of a kernel, in order.
using BufferSizes = std::array<std::uint64_t, most_buffers>;

/// A kernel's line in the table.
struct KernelLine {
  std::string_view name;       ///< the entry point
  std::string_view file;       ///< kernels/LANGUAGE/FILE.EXTENSION
  std::string_view access;     ///< a letter per buffer, in order: r read, w written (or read and written)
  std::size_t argument_bytes;  ///< sizeof of the argument block
  std::vector<MacroRange> macros;
  /// How many floats each buffer must hold. Throws a plain std::string, the cause, for a launch that cannot run.
  BufferSizes (*needed)(const LaunchShape&);
};

/// Every kernel.
[[nodiscard]] std::span<const KernelLine> kernel_table();

/// A kernel's line and the macros it is compiled with: those of the line, given or by default, and no others.
struct FoundKernel {
  const KernelLine* line = nullptr;
  Macros macros;
};
/// Throws a device Error for an unknown name, and a macro that is missing or out of its range.
[[nodiscard]] FoundKernel find_kernel(std::string_view device, std::string_view name, const Macros& macros);

/// The macros with which the kernel suits the device before any tuning: ROWS and STRIPS after its rows_per_group, the
/// others by default; those that every caller must give are left out. Throws as find_kernel() does.
[[nodiscard]] Macros default_macros(const DeviceInfo& device, std::string_view name);

/// The largest n: lavapipe ends an invocation's loops silently after 65,535 iterations, and a kernel's loops stay below
/// that up to here. A dense F of that size has 4 TiB.
inline constexpr std::uint32_t largest_n = 1U << 20;

/// Nodes, or leaves, of a hierarchy that shadow_rays takes: a kernel counts their fours in 31 bits.
inline constexpr std::uint32_t largest_hierarchy = 1U << 27;
/// Rays for one work-group of shadow_rays: on a processor one invocation may take them all, in loops of at most 65,535
/// turns.
inline constexpr std::uint32_t rays_for_a_group = 128;

/// What Queue::launch() checks before it enqueues: number, access and size of the buffers, the argument block, the
/// groups against the device's limit. Throws a device Error "DEVICE: launch KERNEL (LABEL): CAUSE".
void check_launch(const DeviceInfo& device, const KernelLine& line, const Macros& macros, std::uint32_t groups,
                  std::span<Buffer* const> buffers, std::span<const std::byte> arguments, std::string_view label);

/// Throws a device Error unless bytes [offset, offset + bytes) lie in the buffer, and, for an upload, may be written.
void check_range(std::string_view device, const Buffer& buffer, std::size_t offset, std::size_t bytes,
                 std::string_view operation);

/// Throws the device Error "DEVICE: OPERATION: CAUSE".
[[noreturn]] void refuse(std::string_view device, std::string_view operation, std::string_view cause);

/// The object as a backend's own class, or a device Error when another device made it.
template <class Own, class Interface>
[[nodiscard]] Own& own(Interface& object, std::string_view device, std::string_view operation) {
  auto* mine = dynamic_cast<Own*>(&object);
  if (mine == nullptr) refuse(device, operation, "a buffer or kernel of another device");
  return *mine;
}

}  // namespace interflect
