#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/device/compile_cache.h"
#include "interflect/device/device.h"

// The CUDA driver and NVRTC, opened at run time. What is used of them is declared here, with the values and versioned
// names of NVIDIA's documentation, so that neither toolkit nor driver is needed to build.

namespace interflect::cuda {

using Result = int;  ///< CUresult and nvrtcResult; 0 is success
using DevicePointer = std::uint64_t;
struct Context;
struct Stream;
struct Event;
struct Module;
struct Function;
struct CudaGraph;
struct GraphNode;
struct GraphExec;
/// CUDA_KERNEL_NODE_PARAMS_v2.
struct KernelNode {
  Function* function = nullptr;
  unsigned grid_x = 1, grid_y = 1, grid_z = 1;
  unsigned block_x = 1, block_y = 1, block_z = 1;
  unsigned shared_bytes = 0;
  void** parameters = nullptr;
  void** extra = nullptr;
  void* kernel = nullptr;   ///< instead of the function
  void* context = nullptr;  ///< the current one
};
struct Uuid {
  unsigned char bytes[16];
};

/// CU_DEVICE_ATTRIBUTE_..., and the flags that are used.
inline constexpr int max_grid_dim_x = 5, clock_rate = 13, multiprocessor_count = 16, compute_mode = 20;
inline constexpr int capability_major = 75, capability_minor = 76;
inline constexpr int compute_mode_prohibited = 2;
inline constexpr unsigned stream_non_blocking = 1, event_disable_timing = 2;

/// The functions of libcuda.so.1 that are used: member, exported name, parameters.
#define INTERFLECT_CUDA_FUNCTIONS(F)                                                                             \
  F(init, "cuInit", (unsigned flags))                                                                            \
  F(version, "cuDriverGetVersion", (int* version))                                                               \
  F(error_name, "cuGetErrorName", (Result error, const char** name))                                             \
  F(device_count, "cuDeviceGetCount", (int* count))                                                              \
  F(device_get, "cuDeviceGet", (int* device, int ordinal))                                                       \
  F(device_name, "cuDeviceGetName", (char* name, int length, int device))                                        \
  F(device_uuid, "cuDeviceGetUuid_v2", (Uuid * uuid, int device))                                                \
  F(device_memory, "cuDeviceTotalMem_v2", (std::size_t * bytes, int device))                                     \
  F(device_attribute, "cuDeviceGetAttribute", (int* value, int attribute, int device))                           \
  F(context_retain, "cuDevicePrimaryCtxRetain", (Context * *context, int device))                                \
  F(context_release, "cuDevicePrimaryCtxRelease_v2", (int device))                                               \
  F(context_use, "cuCtxSetCurrent", (Context * context))                                                         \
  F(memory_allocate, "cuMemAlloc_v2", (DevicePointer * memory, std::size_t bytes))                               \
  F(memory_free, "cuMemFree_v2", (DevicePointer memory))                                                         \
  F(memory_fill, "cuMemsetD8Async", (DevicePointer to, unsigned char value, std::size_t bytes, Stream* stream))  \
  F(pinned_allocate, "cuMemHostAlloc", (void** memory, std::size_t bytes, unsigned flags))                       \
  F(pinned_free, "cuMemFreeHost", (void* memory))                                                                \
  F(copy_in, "cuMemcpyHtoDAsync_v2", (DevicePointer to, const void* from, std::size_t bytes, Stream* stream))    \
  F(copy_out, "cuMemcpyDtoHAsync_v2", (void* to, DevicePointer from, std::size_t bytes, Stream* stream))         \
  F(stream_create, "cuStreamCreate", (Stream * *stream, unsigned flags))                                         \
  F(stream_destroy, "cuStreamDestroy_v2", (Stream * stream))                                                     \
  F(stream_wait, "cuStreamSynchronize", (Stream * stream))                                                       \
  F(event_create, "cuEventCreate", (Event * *event, unsigned flags))                                             \
  F(event_destroy, "cuEventDestroy_v2", (Event * event))                                                         \
  F(event_record, "cuEventRecord", (Event * event, Stream * stream))                                             \
  F(event_wait, "cuEventSynchronize", (Event * event))                                                           \
  F(module_load, "cuModuleLoadDataEx",                                                                           \
    (Module * *module, const void* image, unsigned count, int* options, void** values))                          \
  F(module_unload, "cuModuleUnload", (Module * module))                                                          \
  F(module_function, "cuModuleGetFunction", (Function * *function, Module * module, const char* name))           \
  F(launch, "cuLaunchKernel",                                                                                    \
    (Function * function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x, unsigned block_y, \
     unsigned block_z, unsigned shared_bytes, Stream* stream, void** parameters, void** extra))

/// Those of graphs, which are from CUDA 12; where one is missing, all stay null.
#define INTERFLECT_CUDA_GRAPH_FUNCTIONS(F)                                                                      \
  F(graph_create, "cuGraphCreate", (CudaGraph * *graph, unsigned flags))                                        \
  F(graph_destroy, "cuGraphDestroy", (CudaGraph * graph))                                                       \
  F(graph_add_kernel, "cuGraphAddKernelNode_v2",                                                                \
    (GraphNode * *node, CudaGraph * graph, GraphNode* const* after, std::size_t count, const KernelNode* what)) \
  F(graph_instantiate, "cuGraphInstantiateWithFlags",                                                           \
    (GraphExec * *exec, CudaGraph * graph, unsigned long long flags))                                           \
  F(graph_launch, "cuGraphLaunch", (GraphExec * exec, Stream * stream))                                         \
  F(graph_exec_destroy, "cuGraphExecDestroy", (GraphExec * exec))

struct Driver {
// NOLINTNEXTLINE(bugprone-macro-parentheses): they are parts of a declaration
#define INTERFLECT_MEMBER(member, name, parameters) Result(*member) parameters = nullptr;
  INTERFLECT_CUDA_FUNCTIONS(INTERFLECT_MEMBER)
  INTERFLECT_CUDA_GRAPH_FUNCTIONS(INTERFLECT_MEMBER)
#undef INTERFLECT_MEMBER

  [[nodiscard]] bool has_graphs() const {
    return graph_launch != nullptr;
  }

  /// libcuda.so.1, initialised; null with the reason why not.
  [[nodiscard]] static const Driver* open(std::string& reason);
  /// "cuMemAlloc: CUDA_ERROR_OUT_OF_MEMORY (2)".
  [[nodiscard]] std::string text(Result error, std::string_view function) const;
};

/// A device that is in use: its primary context.
class Session {
 public:
  Session(const Driver& driver, std::string id, int device);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  ~Session() { cuda.context_release(device_); }

  /// Makes the context the calling thread's; everything but a destructor begins with it.
  void use(std::string_view operation) const { check(cuda.context_use(context_), operation, "cuCtxSetCurrent"); }
  /// Throws a device Error unless the call succeeded.
  void check(Result result, std::string_view operation, std::string_view function) const;

  /// An object of the driver with the function that gives it back. What the driver says to that is ignored: on a lost
  /// device there is nothing left to give back.
  template <class T>
  struct Free {
    const Session* session = nullptr;
    Result (*function)(T*) = nullptr;
    void operator()(T* object) const noexcept {
      session->cuda.context_use(session->context_);
      function(object);
    }
  };
  template <class T>
  using Owned = std::unique_ptr<T, Free<T>>;
  template <class T>
  [[nodiscard]] Owned<T> owned(T* object, Result (*function)(T*)) const {
    return {object, Free<T>{this, function}};
  }
  void free(DevicePointer memory) const noexcept {
    cuda.context_use(context_);
    cuda.memory_free(memory);
  }

  [[nodiscard]] Context* context() const { return context_; }

  const Driver& cuda;
  const std::string id;

 private:
  int device_;
  Context* context_ = nullptr;
};

/// NVRTC, NVIDIA's compiler for kernels at run time.
class Nvrtc {
 public:
  /// Version 12 or newer; null with the reason why not. A driver of CUDA version `driver_major` runs what a compiler of
  /// that or an older version makes, so such a one is taken before a newer one.
  [[nodiscard]] static const Nvrtc* open(int driver_major, std::string& reason);

  [[nodiscard]] std::string version() const;  ///< "12.8"
  /// Compute capabilities, as 90, that it compiles for, the smallest first.
  [[nodiscard]] const std::vector<int>& architectures() const { return architectures_; }
  /// What to compile for a device of that capability: "sm_90"; where NVRTC does not know it, "compute_80" of the newest
  /// that it knows and the device runs (PTX, which the driver compiles further); empty where all are newer.
  [[nodiscard]] std::string target(int capability) const;

  struct Compiled {
    std::vector<std::byte> binary;  ///< a cubin for "sm_", else PTX with a zero at its end; empty after an error
    std::string log;
  };
  [[nodiscard]] Compiled compile(const std::string& source, const std::string& file,
                                 const std::vector<std::string>& options) const;

 private:
  struct Functions;
  static std::shared_ptr<const Nvrtc> load(const std::string& path, std::string& reason);

  std::shared_ptr<const Functions> functions_;
  int major_ = 0, minor_ = 0;
  std::vector<int> architectures_;
};

/// What the binary of kernels/cuda/FILE for `target` depends on. The macros are the kernel's and the backend's own.
[[nodiscard]] CompileKey compile_key(const Nvrtc& nvrtc, const std::string& target, std::string_view file,
                                     const Macros& macros);
/// Compiles it. An error is a device Error with the kernel's file and line, then the compiler's log.
[[nodiscard]] std::vector<std::byte> compile(const Nvrtc& nvrtc, const CompileKey& key, std::string_view device,
                                             std::string_view file);

}  // namespace interflect::cuda
