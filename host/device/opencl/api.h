#pragma once

#ifndef CL_TARGET_OPENCL_VERSION
#define CL_TARGET_OPENCL_VERSION 120
#endif
#include <CL/cl.h>

#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "interflect/device/compile_cache.h"

// What surrounds the OpenCL API: handles that release themselves, error codes in words, the list of devices,
// properties, programs from source or from the cache. Nothing here knows of Interflect's buffers or kernels.

namespace interflect::opencl {

/// An OpenCL object that is released with its handle.
template <class T, cl_int(CL_API_CALL* release)(T)>
struct Release {
  void operator()(T object) const noexcept { release(object); }
};
template <class T, cl_int(CL_API_CALL* release)(T)>
using Handle = std::unique_ptr<std::remove_pointer_t<T>, Release<T, release>>;

using Context = Handle<cl_context, clReleaseContext>;
using CommandQueue = Handle<cl_command_queue, clReleaseCommandQueue>;
using Memory = Handle<cl_mem, clReleaseMemObject>;
using Program = Handle<cl_program, clReleaseProgram>;
using EntryPoint = Handle<cl_kernel, clReleaseKernel>;

/// "CL_OUT_OF_RESOURCES (-5)"; only the number where it is none of OpenCL 1.2.
[[nodiscard]] std::string code_text(cl_int code);

/// Throws the device Error "DEVICE: OPERATION: FUNCTION: CODE" unless the code is CL_SUCCESS.
void succeed(cl_int code, std::string_view device, std::string_view operation, std::string_view function);

/// A device of a platform, or why the platform gives none.
struct Found {
  cl_platform_id platform = nullptr;
  cl_device_id device = nullptr;
  std::string reason;
};
/// Every device of every platform, in the loader's order; without any, one entry with the reason. Throws nothing.
[[nodiscard]] std::vector<Found> find_devices();

/// A property as text, "" where the driver does not answer.
[[nodiscard]] std::string text_of(cl_device_id device, cl_device_info what);
[[nodiscard]] std::string text_of(cl_platform_id platform, cl_platform_info what);

/// A property as a number, 0 where the driver does not answer.
template <class Value>
[[nodiscard]] Value number_of(cl_device_id device, cl_device_info what) {
  Value value = 0;
  return clGetDeviceInfo(device, what, sizeof value, &value, nullptr) == CL_SUCCESS ? value : Value{0};
}

/// The hardware's UUID in lower-case hexadecimal digits, where the driver has cl_khr_device_uuid; else "".
[[nodiscard]] std::string uuid_of(cl_device_id device);

/// The program of `key` (key.source, key.options) for the device, from the cache of compiled kernels where it is there.
/// A binary that the driver refuses is forgotten and compiled anew. Throws a device Error "DEVICE: OPERATION: CAUSE"
/// whose first line names kernel file and line of a compile error, with the compiler's log behind it.
[[nodiscard]] Program load_program(cl_context context, cl_device_id device, const CompileKey& key, std::string_view id,
                                   std::string_view operation);

}  // namespace interflect::opencl
