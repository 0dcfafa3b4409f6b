#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

#include "interflect/device/device.h"

// The kernels of the OpenMP backend: one C++ function in kernels/omp/NAME.cpp each, found by name in one table.
//
// To add a kernel NAME:
//  1. put its argument block into host/device/kernel_arguments.h, its contract into kernels/README.md;
//  2. write `void NAME(const Launch& launch)` in kernels/omp/NAME.cpp, reading its arguments by
//     launch.arguments<NameArguments>(), its buffers by launch.elements<float>(index, count, "what");
//  3. declare it below and add its line to kernel_table() in kernels/omp/table.cpp.
// Number and access of the buffers, the size of the argument block and the macros are checked against that line before
// the function runs. A cause thrown as KernelRefusal becomes a device Error that names device and launch.

namespace interflect::omp {

/// Why a launch cannot run; the queue adds device and label.
struct KernelRefusal {
  std::string cause;
};

/// One launch: what a kernel function gets.
struct Launch {
  std::uint32_t groups = 0;
  std::span<const std::span<std::byte>> buffers;
  std::span<const std::byte> argument_bytes;
  const Macros* macros = nullptr;

  template <class Arguments>
  [[nodiscard]] Arguments arguments() const {
    static_assert(std::is_trivially_copyable_v<Arguments>);
    Arguments block;
    std::memcpy(&block, argument_bytes.data(), sizeof block);  // the table's line has checked the size
    return block;
  }
  /// Buffer `index` as an array of T; refuses when it holds fewer than `count` of them.
  template <class T>
  [[nodiscard]] T* elements(std::size_t index, std::uint64_t count, std::string_view what) const {
    if (buffers[index].size() / sizeof(T) < count) refuse_size(index, count * sizeof(T), what);
    return reinterpret_cast<T*>(buffers[index].data());
  }
  /// The macro's value; kernel() has checked that it is there and in range.
  [[nodiscard]] int macro(std::string_view name) const { return macros->at(std::string(name)); }

 private:
  [[noreturn]] void refuse_size(std::size_t index, std::uint64_t bytes, std::string_view what) const;
};

/// A macro that a kernel takes, and the values it may have.
struct MacroRange {
  std::string_view name;
  int smallest;
  int largest;
};

/// A kernel's line in the table.
struct TableLine {
  std::string_view name;
  void (*run)(const Launch&);
  std::string_view access;     ///< a letter per buffer, in order: r read, w written (or read and written)
  std::size_t argument_bytes;  ///< sizeof of the argument block
  std::vector<MacroRange> macros;
};

/// Every kernel of this backend.
[[nodiscard]] std::span<const TableLine> kernel_table();

void copy(const Launch& launch);
void matvec(const Launch& launch);
void read(const Launch& launch);

void dot(const Launch& launch);
void reduce(const Launch& launch);
void axpby(const Launch& launch);
void bounce(const Launch& launch);
void cg_product(const Launch& launch);
void cg_step(const Launch& launch);
void bicgstab_product(const Launch& launch);
void bicgstab_half(const Launch& launch);
void bicgstab_step(const Launch& launch);

}  // namespace interflect::omp
