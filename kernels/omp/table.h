#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "interflect/device/kernel_table.h"

// The kernels of the OpenMP backend: one C++ function in kernels/omp/FILE.cpp each. The queue has checked a launch
// against host/device/kernel_table.h before a function runs.
//
// To add kernel NAME here: write `void NAME(const Launch& launch)` in kernels/omp/FILE.cpp, declare it below and add it
// to table.cpp.

namespace interflect::omp {

/// One launch: what a kernel function gets.
struct Launch : LaunchShape {
  std::span<const std::span<std::byte>> buffers;

  template <class Value>
  [[nodiscard]] Value* pointer(std::size_t buffer) const {
    return reinterpret_cast<Value*>(buffers[buffer].data());
  }
  [[nodiscard]] float* floats(std::size_t buffer) const { return pointer<float>(buffer); }
};

using Function = void (*)(const Launch&);
/// The kernel's function; null when there is none of that name.
[[nodiscard]] Function find_function(std::string_view name);

void copy(const Launch& launch);
void matvec(const Launch& launch);
void read(const Launch& launch);
void matvec_exact(const Launch& launch);
void close_rows(const Launch& launch);

void shadow_rays(const Launch& launch);

void scale(const Launch& launch);
void tiles16(const Launch& launch);
void sym16(const Launch& launch);
void sym16_fold(const Launch& launch);

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
