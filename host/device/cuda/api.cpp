#include "interflect/device/cuda/api.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <mutex>
#include <optional>

#include "interflect/device/kernel_table.h"

namespace interflect::cuda {

namespace {

/// Fills in the functions; the name of the first that is missing, or null.
const char* find_functions(void* library, Driver& driver) {
#define INTERFLECT_FIND(member, name, parameters)                                      \
  driver.member = reinterpret_cast<decltype(driver.member)>(::dlsym(library, (name))); \
  if (driver.member == nullptr) return name;
  INTERFLECT_CUDA_FUNCTIONS(INTERFLECT_FIND)
#undef INTERFLECT_FIND
  return nullptr;
}

/// Those of graphs, all or none.
void find_graphs(void* library, Driver& driver) {
  Driver found = driver;
#define INTERFLECT_FIND(member, name, parameters)                                    \
  found.member = reinterpret_cast<decltype(found.member)>(::dlsym(library, (name))); \
  if (found.member == nullptr) return;
  INTERFLECT_CUDA_GRAPH_FUNCTIONS(INTERFLECT_FIND)
#undef INTERFLECT_FIND
  driver = found;
}

}  // namespace

const Driver* Driver::open(std::string& reason) {
  static std::mutex mutex;
  static std::optional<Driver> driver;  // once open it stays so: a driver does not like to be unloaded
  const std::lock_guard lock(mutex);
  if (!driver) {
    void* library = ::dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (library == nullptr) {
      const std::string cause = ::dlerror();
      const bool missing = cause.find("No such file") != std::string::npos;
      reason = missing ? "libcuda.so.1 not found" : "libcuda.so.1: " + cause;
      return nullptr;
    }
    Driver found;
    if (const char* name = find_functions(library, found)) {
      reason = fmt::format("libcuda.so.1: has no function {}", name);
      return nullptr;
    }
    find_graphs(library, found);
    driver = found;
  }
  if (const Result result = driver->init(0); result != 0) {
    reason = "libcuda.so.1: " + driver->text(result, "cuInit");
    return nullptr;
  }
  return &*driver;
}

std::string Driver::text(Result error, std::string_view function) const {
  const char* name = nullptr;
  if (error_name(error, &name) != 0 || name == nullptr) name = "an error without a name";
  return fmt::format("{}: {} ({})", function, name, error);
}

Session::Session(const Driver& driver, std::string device_id, int device)
    : cuda(driver), id(std::move(device_id)), device_(device) {
  check(cuda.context_retain(&context_, device), "open", "cuDevicePrimaryCtxRetain");
}

void Session::check(Result result, std::string_view operation, std::string_view function) const {
  if (result != 0) refuse(id, operation, cuda.text(result, function));
}

}  // namespace interflect::cuda
