#include "interflect/device/opencl/api.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/kernel_table.h"

namespace interflect::opencl {

namespace {

constexpr cl_int platform_not_found = -1001;    // CL_PLATFORM_NOT_FOUND_KHR, of cl_khr_icd
constexpr cl_device_info device_uuid = 0x106A;  // CL_DEVICE_UUID_KHR, of cl_khr_device_uuid
constexpr std::size_t longest_log = 16384;      // of a compiler, in an error's message

#define INTERFLECT_CODE(code)           \
  std::pair<cl_int, std::string_view> { \
    code, #code                         \
  }
constexpr std::array codes{
    INTERFLECT_CODE(CL_DEVICE_NOT_FOUND),
    INTERFLECT_CODE(CL_DEVICE_NOT_AVAILABLE),
    INTERFLECT_CODE(CL_COMPILER_NOT_AVAILABLE),
    INTERFLECT_CODE(CL_MEM_OBJECT_ALLOCATION_FAILURE),
    INTERFLECT_CODE(CL_OUT_OF_RESOURCES),
    INTERFLECT_CODE(CL_OUT_OF_HOST_MEMORY),
    INTERFLECT_CODE(CL_MEM_COPY_OVERLAP),
    INTERFLECT_CODE(CL_BUILD_PROGRAM_FAILURE),
    INTERFLECT_CODE(CL_MAP_FAILURE),
    INTERFLECT_CODE(CL_MISALIGNED_SUB_BUFFER_OFFSET),
    INTERFLECT_CODE(CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST),
    INTERFLECT_CODE(CL_COMPILE_PROGRAM_FAILURE),
    INTERFLECT_CODE(CL_LINKER_NOT_AVAILABLE),
    INTERFLECT_CODE(CL_LINK_PROGRAM_FAILURE),
    INTERFLECT_CODE(CL_KERNEL_ARG_INFO_NOT_AVAILABLE),
    INTERFLECT_CODE(CL_INVALID_VALUE),
    INTERFLECT_CODE(CL_INVALID_DEVICE_TYPE),
    INTERFLECT_CODE(CL_INVALID_PLATFORM),
    INTERFLECT_CODE(CL_INVALID_DEVICE),
    INTERFLECT_CODE(CL_INVALID_CONTEXT),
    INTERFLECT_CODE(CL_INVALID_QUEUE_PROPERTIES),
    INTERFLECT_CODE(CL_INVALID_COMMAND_QUEUE),
    INTERFLECT_CODE(CL_INVALID_HOST_PTR),
    INTERFLECT_CODE(CL_INVALID_MEM_OBJECT),
    INTERFLECT_CODE(CL_INVALID_BINARY),
    INTERFLECT_CODE(CL_INVALID_BUILD_OPTIONS),
    INTERFLECT_CODE(CL_INVALID_PROGRAM),
    INTERFLECT_CODE(CL_INVALID_PROGRAM_EXECUTABLE),
    INTERFLECT_CODE(CL_INVALID_KERNEL_NAME),
    INTERFLECT_CODE(CL_INVALID_KERNEL_DEFINITION),
    INTERFLECT_CODE(CL_INVALID_KERNEL),
    INTERFLECT_CODE(CL_INVALID_ARG_INDEX),
    INTERFLECT_CODE(CL_INVALID_ARG_VALUE),
    INTERFLECT_CODE(CL_INVALID_ARG_SIZE),
    INTERFLECT_CODE(CL_INVALID_KERNEL_ARGS),
    INTERFLECT_CODE(CL_INVALID_WORK_DIMENSION),
    INTERFLECT_CODE(CL_INVALID_WORK_GROUP_SIZE),
    INTERFLECT_CODE(CL_INVALID_WORK_ITEM_SIZE),
    INTERFLECT_CODE(CL_INVALID_GLOBAL_OFFSET),
    INTERFLECT_CODE(CL_INVALID_EVENT_WAIT_LIST),
    INTERFLECT_CODE(CL_INVALID_EVENT),
    INTERFLECT_CODE(CL_INVALID_OPERATION),
    INTERFLECT_CODE(CL_INVALID_BUFFER_SIZE),
    INTERFLECT_CODE(CL_INVALID_GLOBAL_WORK_SIZE),
    INTERFLECT_CODE(CL_INVALID_PROPERTY),
    INTERFLECT_CODE(CL_INVALID_COMPILER_OPTIONS),
    INTERFLECT_CODE(CL_INVALID_LINKER_OPTIONS),
    INTERFLECT_CODE(CL_INVALID_DEVICE_PARTITION_COUNT),
};
#undef INTERFLECT_CODE

/// A text that the API hands out in two calls: its size, then its characters.
template <class Object, class Get>
std::string text(Object object, Get get, cl_uint what) {
  std::size_t size = 0;
  if (get(object, what, 0, nullptr, &size) != CL_SUCCESS || size == 0) return "";
  std::string value(size, '\0');
  if (get(object, what, size, value.data(), nullptr) != CL_SUCCESS) return "";
  value.erase(std::find(value.begin(), value.end(), '\0'), value.end());
  while (!value.empty() && value.back() == ' ') value.pop_back();
  return value;
}

std::string build_log(cl_program program, cl_device_id device) {
  const auto get = [device](cl_program p, cl_uint what, std::size_t size, void* value, std::size_t* needed) {
    return clGetProgramBuildInfo(p, device, what, size, value, needed);
  };
  std::string log = text(program, get, CL_PROGRAM_BUILD_LOG);
  if (log.size() > longest_log) log.replace(longest_log, std::string::npos, "\n...");
  return log;
}

/// The line of a compiler's log that says what is wrong first; the log's first line where none says "error".
std::string_view first_error(std::string_view log) {
  for (std::size_t begin = 0; begin < log.size();) {
    const std::size_t end = std::min(log.find('\n', begin), log.size());
    const std::string_view line = log.substr(begin, end - begin);
    if (line.find("error") != std::string_view::npos) return line;
    begin = end + 1;
  }
  return log.substr(0, log.find('\n'));
}

Program build_source(cl_context context, cl_device_id device, const CompileKey& key, std::string_view id,
                     std::string_view operation) {
  const char* source = key.source.data();
  const std::size_t length = key.source.size();
  cl_int code = CL_SUCCESS;
  Program program(clCreateProgramWithSource(context, 1, &source, &length, &code));
  succeed(code, id, operation, "clCreateProgramWithSource");
  code = clBuildProgram(program.get(), 1, &device, key.options.c_str(), nullptr, nullptr);
  if (code != CL_SUCCESS) {
    const std::string log = build_log(program.get(), device);
    const Error first =
        device_error(id, operation, fmt::format("{} (clBuildProgram: {})", first_error(log), code_text(code)));
    throw Error(ErrorKind::device, fmt::format("{}\n{}", first.what(), log));
  }
  return program;
}

std::vector<std::byte> binary_of(cl_program program, std::string_view id, std::string_view operation) {
  std::size_t size = 0;  // the program has one device
  succeed(clGetProgramInfo(program, CL_PROGRAM_BINARY_SIZES, sizeof size, &size, nullptr), id, operation,
          "clGetProgramInfo(CL_PROGRAM_BINARY_SIZES)");
  std::vector<std::byte> binary(size);
  auto* bytes = reinterpret_cast<unsigned char*>(binary.data());
  succeed(clGetProgramInfo(program, CL_PROGRAM_BINARIES, sizeof bytes, &bytes, nullptr), id, operation,
          "clGetProgramInfo(CL_PROGRAM_BINARIES)");
  return binary;
}

/// Null when the driver refuses the binary.
Program build_binary(cl_context context, cl_device_id device, const std::vector<std::byte>& binary,
                     const std::string& options) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(binary.data());
  const std::size_t size = binary.size();
  cl_int accepted = CL_SUCCESS;
  cl_int code = CL_SUCCESS;
  if (size == 0) return nullptr;
  Program program(clCreateProgramWithBinary(context, 1, &device, &size, &bytes, &accepted, &code));
  if (code != CL_SUCCESS || accepted != CL_SUCCESS) return nullptr;
  code = clBuildProgram(program.get(), 1, &device, options.c_str(), nullptr, nullptr);
  return code == CL_SUCCESS ? std::move(program) : nullptr;
}

}  // namespace

std::string code_text(cl_int code) {
  const auto* found =
      std::find_if(codes.begin(), codes.end(), [code](const auto& known) { return known.first == code; });
  return found == codes.end() ? fmt::format("OpenCL error {}", code) : fmt::format("{} ({})", found->second, code);
}

void succeed(cl_int code, std::string_view device, std::string_view operation, std::string_view function) {
  if (code != CL_SUCCESS) refuse(device, operation, fmt::format("{}: {}", function, code_text(code)));
}

std::vector<Found> find_devices() {
  cl_uint count = 0;
  cl_int code = clGetPlatformIDs(0, nullptr, &count);
  if (code == platform_not_found || (code == CL_SUCCESS && count == 0)) {
    return {{nullptr, nullptr, "no OpenCL platform found: is a driver (ICD) installed?"}};
  }
  std::vector<cl_platform_id> platforms(count);
  if (code == CL_SUCCESS) code = clGetPlatformIDs(count, platforms.data(), nullptr);
  if (code != CL_SUCCESS) return {{nullptr, nullptr, "clGetPlatformIDs: " + code_text(code)}};

  std::vector<Found> all;
  for (const cl_platform_id platform : platforms) {
    code = clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 0, nullptr, &count);
    std::vector<cl_device_id> devices(code == CL_SUCCESS ? count : 0);
    if (!devices.empty()) code = clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, count, devices.data(), nullptr);
    if (code == CL_SUCCESS) {
      for (const cl_device_id device : devices) all.push_back({platform, device, ""});
    } else if (code != CL_DEVICE_NOT_FOUND) {
      all.push_back({platform, nullptr, "clGetDeviceIDs: " + code_text(code)});
    }
  }
  if (all.empty()) all.push_back({platforms.front(), nullptr, "the OpenCL platforms have no device"});
  return all;
}

std::string text_of(cl_device_id device, cl_device_info what) {
  return text(device, clGetDeviceInfo, what);
}

std::string text_of(cl_platform_id platform, cl_platform_info what) {
  return text(platform, clGetPlatformInfo, what);
}

std::string uuid_of(cl_device_id device) {
  std::array<unsigned char, 16> bytes{};
  if (text_of(device, CL_DEVICE_EXTENSIONS).find("cl_khr_device_uuid") == std::string::npos ||
      clGetDeviceInfo(device, device_uuid, bytes.size(), bytes.data(), nullptr) != CL_SUCCESS) {
    return "";
  }
  std::string digits;
  for (const unsigned char byte : bytes) digits += fmt::format("{:02x}", byte);
  return digits;
}

Program load_program(cl_context context, cl_device_id device, const CompileKey& key, std::string_view id,
                     std::string_view operation) {
  Program program;
  const auto compile = [&] {
    program = build_source(context, device, key, id, operation);
    return binary_of(program.get(), id, operation);
  };
  const std::vector<std::byte> binary = cached_compile(key, compile);
  if (program != nullptr) return program;
  const Timer timer;
  program = build_binary(context, device, binary, key.options);
  add_compile_seconds(timer.seconds());
  if (program == nullptr) {
    forget_compiled(key);
    static_cast<void>(cached_compile(key, compile));
  }
  return program;
}

}  // namespace interflect::opencl
