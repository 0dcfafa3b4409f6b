#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <utility>

#include "interflect/base/half.h"

// For tests only: kernels/cuda/*.cu as C++ on the processor. Blocks run in a loop; the threads of a block are fibers
// that really switch at __syncthreads and at every exchange between the lanes of a warp, in an order of the test's
// choice. A file that kernel_variants.cmake writes includes this header and then the kernel's text, once for each set
// of macros.
//
// Before each block its shared memory is filled with NaN, so that what a thread reads before it was written shows.

namespace interflect::cuda_on_cpu {

/// In which order the threads of a block run between two points where they wait. No result may depend on it.
enum class Order { forwards, backwards, shuffled };
void use_order(Order order);

/// A kernel as it was compiled for the processor.
struct Compiled {
  std::string variant;  ///< empty: as it is; else the name of the defect that it was given
  std::string kernel;
  std::map<std::string, int> macros;  ///< but WORKGROUP
  void (*thread)(void* const* parameters) = nullptr;
  std::uint32_t pointers = 0;     ///< bit i: parameter i is a pointer
  std::uint32_t parameters = 0;   ///< how many
  std::uint32_t block_bytes = 0;  ///< size of the last parameter, the argument block
};
void add(Compiled compiled);
/// The kernel of that variant, or, where the variant does not change it, as it is; null when it was not built. Macros
/// that it was built without (PREFETCH, which means nothing to a GPU) may be among those asked for.
[[nodiscard]] const Compiled* find(const std::string& variant, const std::string& kernel,
                                   const std::map<std::string, int>& macros);

/// Whether the variant changes that kernel, with whatever macros.
[[nodiscard]] bool changes(const std::string& variant, const std::string& kernel);

/// Runs grid blocks of `threads` threads. `parameters` are pointers to the kernel's parameters, as for cuLaunchKernel.
/// Throws std::runtime_error when threads wait for each other for ever, or a thread ends while others wait for it.
void run(const Compiled& kernel, std::uint32_t grid, std::uint32_t threads, void* const* parameters);

/// One exchange between the lanes of a warp: gives `bits` and takes those of lane `from`.
[[nodiscard]] std::uint32_t exchange(std::uint32_t bits, std::uint32_t from);
/// Waits for all threads of the block.
void block_barrier();
/// Waits for all threads of the warp.
void warp_barrier();

template <class... Parameters, std::size_t... Place>
void call(void (*kernel)(Parameters...), void* const* parameters, std::index_sequence<Place...>) {
  kernel(*static_cast<std::remove_cv_t<Parameters>*>(parameters[Place])...);
}
template <auto Kernel>
struct Entry;
template <class... Parameters, void (*Kernel)(Parameters...)>
struct Entry<Kernel> {
  static void thread(void* const* parameters) { call(Kernel, parameters, std::index_sequence_for<Parameters...>()); }
  static Compiled compiled(std::string variant, std::string kernel, std::map<std::string, int> macros) {
    Compiled made{std::move(variant), std::move(kernel), std::move(macros), &thread, 0, sizeof...(Parameters), 0};
    std::uint32_t bit = 1;
    ((made.pointers |= std::is_pointer_v<Parameters> ? bit : 0U, bit <<= 1U, made.block_bytes = sizeof(Parameters)),
     ...);
    return made;
  }
};
template <auto Kernel>
bool added(std::string variant, std::string kernel, std::map<std::string, int> macros) {
  add(Entry<Kernel>::compiled(std::move(variant), std::move(kernel), std::move(macros)));
  return true;
}

}  // namespace interflect::cuda_on_cpu

// The words of CUDA that the kernels use.

#define __global__
#define __device__ [[maybe_unused]] static inline
#define __launch_bounds__(...)
// In a section of its own, so that all of it can be filled before a block.
#define __shared__ static __attribute__((section("cuda_shared")))

struct ThreadIndex {
  unsigned x, y, z;
};
extern ThreadIndex threadIdx, blockIdx, blockDim, gridDim;

struct __attribute__((may_alias, aligned(16))) float4 {
  float x, y, z, w;
};
struct __attribute__((may_alias, aligned(16))) uint4 {
  unsigned x, y, z, w;
};
inline float4 make_float4(float x, float y, float z, float w) {
  return {x, y, z, w};
}
/// What an instruction of a GPU does.
inline float half_to_float(unsigned bits) {
  return interflect::from_half(static_cast<interflect::Half>(bits));
}
template <class T>
T __ldg(const T* from) {
  return *from;
}
template <class T>
T __ldcs(const T* from) {
  return *from;
}
template <class T>
void __stcs(T* to, T value) {
  *to = value;
}
/// A product that no compiler folds into a sum.
inline float __fmul_rn(float a, float b) {
  volatile float product = a * b;
  return product;
}
inline float __fsub_rn(float a, float b) {
  return a - b;
}
inline float __uint_as_float(unsigned bits) {
  float value = 0;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
inline unsigned __float_as_uint(float value) {
  unsigned bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}
/// Threads are fibers of one thread.
inline unsigned atomicAdd(unsigned* to, unsigned value) {
  const unsigned before = *to;
  *to += value;
  return before;
}
inline void __syncthreads() {
  interflect::cuda_on_cpu::block_barrier();
}
inline void __syncwarp(unsigned /*mask*/ = 0xFFFFFFFFU) {
  interflect::cuda_on_cpu::warp_barrier();
}

inline float exchanged(float value, unsigned from) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  bits = interflect::cuda_on_cpu::exchange(bits, from);
  std::memcpy(&value, &bits, sizeof bits);
  return value;
}
inline float __shfl_sync(unsigned /*mask*/, float value, unsigned lane) {
  return exchanged(value, lane % 32);
}
inline float __shfl_xor_sync(unsigned /*mask*/, float value, unsigned lanes) {
  return exchanged(value, (threadIdx.x % 32) ^ lanes);
}
inline float __shfl_down_sync(unsigned /*mask*/, float value, unsigned lanes) {
  const unsigned from = threadIdx.x % 32 + lanes;
  return exchanged(value, from < 32 ? from : threadIdx.x % 32);
}
