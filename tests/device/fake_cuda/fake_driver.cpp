#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include "device/cuda_on_cpu.h"
#include "device/fake_cuda/fake_cuda.h"
#include "interflect/device/cuda/api.h"

namespace {

using interflect::cuda::DevicePointer;
using interflect::cuda::Result;
using interflect::cuda::Uuid;
namespace cuda_on_cpu = interflect::cuda_on_cpu;

// CUresult, as documented.
constexpr Result invalid_value = 1, no_memory = 2, no_device = 100, invalid_device = 101, invalid_image = 200,
                 invalid_context = 201, wrong_architecture = 209, invalid_handle = 400, not_found = 500,
                 launch_failed = 719, unknown = 999;

// A device pointer is an address that the host cannot use.
constexpr DevicePointer device_bit = DevicePointer{1} << 60U;
constexpr std::size_t device_bytes = std::size_t{1} << 30U;
constexpr int capability = 90;

struct Free {
  void operator()(std::byte* p) const { ::operator delete[](p, std::align_val_t{256}); }
};
struct Memory {
  std::unique_ptr<std::byte[], Free> bytes;
  std::size_t size = 0;
};
Memory allocate(std::size_t size) {
  Memory memory{std::unique_ptr<std::byte[], Free>(new (std::align_val_t{256}) std::byte[size]), size};
  std::memset(memory.bytes.get(), 0xA5, size);  // rubbish
  return memory;
}

struct Stream {
  std::deque<std::function<Result()>> work;
  Result failed = 0;
};
struct Event {
  Stream* stream = nullptr;
  int recorded = 0, passed = 0;  ///< how many times
};
struct Function {
  const cuda_on_cpu::Compiled* compiled = nullptr;
};
struct Module {
  std::map<std::string, int> macros;
  std::vector<std::unique_ptr<Function>> functions;
};

int number(const char* variable, int otherwise) {
  const char* value = std::getenv(variable);
  return value == nullptr ? otherwise : std::atoi(value);
}

class Fake {
 public:
  Fake() { fail(number("FAKE_CUDA_FAIL", 0), unknown, number("FAKE_CUDA_LOST", 0) != 0); }
  ~Fake() {
    const char* path = std::getenv("FAKE_CUDA_REPORT");
    if (path == nullptr) return;
    if (std::FILE* file = std::fopen(path, "w")) {
      std::fputs(report().c_str(), file);
      std::fclose(file);
    }
  }

  void fail(int call, Result code, bool lost) {
    failing_ = call;
    code_ = code;
    lost_ = lost;
  }
  void reset() {
    calls = kernels = 0;
    broken_rules.clear();
    fail(0, unknown, false);
  }

  /// Counts a call; what it must return without doing anything, or 0.
  Result count() {
    ++calls;
    return failing_ != 0 && (calls == failing_ || (lost_ && calls > failing_)) ? code_ : 0;
  }
  /// As count(), for calls that need a current context.
  Result enter() {
    const Result result = count();
    if (result == 0 && current == nullptr) return broke("a call without a current context", invalid_context);
    return result;
  }
  Result broke(const std::string& rule, Result result) {
    broken_rules.push_back(rule);
    return result;
  }

  /// The host's address of device memory [at, at + size); null when it is not all of one allocation.
  std::byte* host(DevicePointer at, std::size_t size) {
    const auto after = memory.upper_bound(at);
    if (after == memory.begin()) return nullptr;
    const auto& [start, block] = *std::prev(after);
    if (at - start > block.size || size > block.size - (at - start)) return nullptr;
    return block.bytes.get() + (at - start);
  }
  bool is_pinned(const void* at, std::size_t size) const {
    for (const auto& [start, block] : pinned) {
      const auto* byte = static_cast<const std::byte*>(at);
      if (byte >= block.bytes.get() && byte + size <= block.bytes.get() + block.size) return true;
    }
    return false;
  }

  Result drain(Stream& stream, std::size_t keep = 0) {
    while (stream.work.size() > keep) {
      const auto work = std::move(stream.work.front());
      stream.work.pop_front();
      if (stream.failed == 0) stream.failed = work();
    }
    return stream.failed;
  }
  void drain_all() {
    for (auto& [key, stream] : streams) (void)drain(*stream);
  }

  std::string report() const {
    const std::size_t live = memory.size() + pinned.size() + streams.size() + events.size() + modules.size() +
                             static_cast<std::size_t>(contexts);
    std::string text = "calls=" + std::to_string(calls) + " kernels=" + std::to_string(kernels) +
                       " live=" + std::to_string(live) + "\n";
    const auto line = [&](const char* what, std::size_t count) {
      if (count != 0) text += "live: " + std::to_string(count) + " " + what + "\n";
    };
    line("device memory", memory.size());
    line("pinned memory", pinned.size());
    line("streams", streams.size());
    line("events", events.size());
    line("modules", modules.size());
    line("contexts", static_cast<std::size_t>(contexts));
    for (const std::string& rule : broken_rules) text += "broken: " + rule + "\n";
    return text;
  }

  std::mutex mutex;
  int devices = number("FAKE_CUDA_DEVICES", 1);
  int calls = 0, kernels = 0, contexts = 0;
  static thread_local void* current;
  std::map<DevicePointer, Memory> memory;
  std::map<const void*, Memory> pinned;
  std::map<const void*, std::unique_ptr<Stream>> streams;
  std::map<const void*, std::unique_ptr<Event>> events;
  std::map<const void*, std::unique_ptr<Module>> modules;
  std::vector<std::string> broken_rules;

 private:
  int failing_ = 0;
  Result code_ = unknown;
  bool lost_ = false;
};
thread_local void* Fake::current = nullptr;

Fake& fake() {
  static Fake one;
  return one;
}

/// The object of that handle; null and a broken rule when there is none.
template <class T>
T* find(std::map<const void*, std::unique_ptr<T>>& all, const void* handle, const char* what) {
  const auto found = all.find(handle);
  if (found != all.end()) return found->second.get();
  fake().broken_rules.push_back(std::string("a ") + what + " that does not exist");
  return nullptr;
}
template <class T>
T* add(std::map<const void*, std::unique_ptr<T>>& all) {
  auto object = std::make_unique<T>();
  T* raw = object.get();
  all.emplace(raw, std::move(object));
  return raw;
}

/// Parameters as cuLaunchKernel copies them, device pointers turned into addresses.
struct Parameters {
  std::vector<std::uint64_t> words = std::vector<std::uint64_t>(64);
  std::vector<void*> places;
};

Result copy_parameters(const cuda_on_cpu::Compiled& kernel, void** given, Parameters& copied) {
  std::size_t at = 0;
  for (std::uint32_t i = 0; i < kernel.parameters; ++i) {
    copied.places.push_back(&copied.words[at]);
    if ((kernel.pointers >> i & 1U) != 0) {
      DevicePointer pointer = 0;
      std::memcpy(&pointer, given[i], sizeof pointer);
      std::byte* host = fake().host(pointer, 1);
      if (host == nullptr) return fake().broke(kernel.kernel + ": a pointer to no device memory", invalid_value);
      std::memcpy(&copied.words[at++], &host, sizeof host);
    } else {
      std::memcpy(&copied.words[at], given[i], kernel.block_bytes);
      at += (kernel.block_bytes + 7) / 8;
    }
  }
  return 0;
}

}  // namespace

#define FAKE_ENTER(counted)                 \
  const std::lock_guard lock(fake().mutex); \
  if (const Result result = (counted); result != 0) return result

// The exported functions, with the names of cuda.h. Handles are opaque to the caller.
extern "C" {

void fake_cuda_reset() {
  fake().reset();
}
void fake_cuda_fail(int call, int code, bool lost) {
  fake().fail(fake().calls + call, code, lost);
}
void fake_cuda_devices(int count) {
  fake().devices = count;
}
int fake_cuda_calls() {
  return fake().calls;
}
const char* fake_cuda_report() {
  static std::string text;
  text = fake().report();
  return text.c_str();
}

Result cuInit(unsigned) {
  FAKE_ENTER(fake().count());
  return number("FAKE_CUDA_INIT", 0);
}
Result cuDriverGetVersion(int* version) {
  FAKE_ENTER(fake().count());
  *version = 12080;
  return 0;
}
Result cuGetErrorName(Result error, const char** name) {
  static const std::map<Result, const char*> names = {
      {1, "CUDA_ERROR_INVALID_VALUE"},       {2, "CUDA_ERROR_OUT_OF_MEMORY"},    {100, "CUDA_ERROR_NO_DEVICE"},
      {101, "CUDA_ERROR_INVALID_DEVICE"},    {200, "CUDA_ERROR_INVALID_IMAGE"},  {201, "CUDA_ERROR_INVALID_CONTEXT"},
      {209, "CUDA_ERROR_NO_BINARY_FOR_GPU"}, {400, "CUDA_ERROR_INVALID_HANDLE"}, {500, "CUDA_ERROR_NOT_FOUND"},
      {719, "CUDA_ERROR_LAUNCH_FAILED"},     {999, "CUDA_ERROR_UNKNOWN"}};
  const auto found = names.find(error);
  *name = found == names.end() ? nullptr : found->second;
  return found == names.end() ? invalid_value : 0;
}
Result cuDeviceGetCount(int* count) {
  FAKE_ENTER(fake().count());
  *count = fake().devices;
  return 0;
}
Result cuDeviceGet(int* device, int ordinal) {
  FAKE_ENTER(fake().count());
  if (ordinal < 0 || ordinal >= fake().devices) return invalid_device;
  *device = ordinal + 40;  // not the ordinal, so that mixing them up shows
  return 0;
}
Result cuDeviceGetName(char* name, int length, int) {
  FAKE_ENTER(fake().count());
  std::snprintf(name, static_cast<std::size_t>(length), "Fake GPU (runs on the processor)");
  return 0;
}
Result cuDeviceGetUuid_v2(Uuid* uuid, int device) {
  FAKE_ENTER(fake().count());
  for (unsigned i = 0; i < 16; ++i)
    uuid->bytes[i] = static_cast<unsigned char>(0xF0U + i + static_cast<unsigned>(device));
  return 0;
}
Result cuDeviceTotalMem_v2(std::size_t* bytes, int) {
  FAKE_ENTER(fake().count());
  *bytes = device_bytes;
  return 0;
}
Result cuDeviceGetAttribute(int* value, int attribute, int device) {
  FAKE_ENTER(fake().count());
  if (device < 40 || device >= 40 + fake().devices) return invalid_device;
  static const std::map<int, int> values = {
      {5, 0x7FFFFFFF}, {16, 4}, {20, 0}, {75, capability / 10}, {76, capability % 10}};
  const auto found = values.find(attribute);
  if (found == values.end()) return invalid_value;
  *value = found->second;
  return 0;
}

Result cuDevicePrimaryCtxRetain(void** context, int device) {
  FAKE_ENTER(fake().count());
  if (device < 40 || device >= 40 + fake().devices) return invalid_device;
  ++fake().contexts;
  static char primary[8];
  *context = &primary[device - 40];
  return 0;
}
Result cuDevicePrimaryCtxRelease_v2(int) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().count();
  Fake& f = fake();
  if (--f.contexts == 0 &&
      !(f.memory.empty() && f.pinned.empty() && f.streams.empty() && f.events.empty() && f.modules.empty())) {
    return f.broke("the context was released before what was made in it", invalid_context);
  }
  if (f.contexts < 0) return f.broke("a context was released twice", invalid_context);
  return result;
}
Result cuCtxSetCurrent(void* context) {
  FAKE_ENTER(fake().count());
  Fake::current = context;
  return 0;
}

Result cuMemAlloc_v2(DevicePointer* memory, std::size_t bytes) {
  FAKE_ENTER(fake().enter());
  if (bytes == 0) return invalid_value;
  std::size_t used = 0;
  for (const auto& [start, block] : fake().memory) used += block.size;
  if (bytes > device_bytes - used) return no_memory;
  Memory made = allocate(bytes);
  *memory = reinterpret_cast<DevicePointer>(made.bytes.get()) | device_bit;
  fake().memory.emplace(*memory, std::move(made));
  return 0;
}
Result cuMemFree_v2(DevicePointer memory) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  fake().drain_all();
  if (fake().memory.erase(memory) == 0) return fake().broke("memory freed that is not there", invalid_value);
  return result;
}
Result cuMemHostAlloc(void** memory, std::size_t bytes, unsigned) {
  FAKE_ENTER(fake().enter());
  Memory made = allocate(bytes);
  *memory = made.bytes.get();
  fake().pinned.emplace(*memory, std::move(made));
  return 0;
}
Result cuMemFreeHost(void* memory) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  for (const auto& [key, stream] : fake().streams) {
    if (!stream->work.empty())
      return fake().broke("pinned memory freed while a stream may still use it", invalid_value);
  }
  if (fake().pinned.erase(memory) == 0) return fake().broke("pinned memory freed that is not there", invalid_value);
  return result;
}

Result cuStreamCreate(void** stream, unsigned) {
  FAKE_ENTER(fake().enter());
  *stream = add(fake().streams);
  return 0;
}
Result cuStreamDestroy_v2(void* handle) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  Stream* stream = find(fake().streams, handle, "stream");
  if (stream == nullptr) return invalid_handle;
  (void)fake().drain(*stream);
  fake().streams.erase(handle);
  return result;
}
Result cuStreamSynchronize(void* handle) {
  const std::lock_guard lock(fake().mutex);
  Result result = fake().enter();
  Stream* stream = find(fake().streams, handle, "stream");
  if (stream == nullptr) return invalid_handle;
  const Result failed = fake().drain(*stream);
  return result != 0 ? result : failed;
}
Result cuEventCreate(void** event, unsigned) {
  FAKE_ENTER(fake().enter());
  *event = add(fake().events);
  return 0;
}
Result cuEventDestroy_v2(void* handle) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  if (find(fake().events, handle, "event") == nullptr) return invalid_handle;
  for (const auto& [key, stream] : fake().streams) (void)fake().drain(*stream);
  fake().events.erase(handle);
  return result;
}
Result cuEventRecord(void* handle, void* stream_handle) {
  FAKE_ENTER(fake().enter());
  Event* event = find(fake().events, handle, "event");
  Stream* stream = find(fake().streams, stream_handle, "stream");
  if (event == nullptr || stream == nullptr) return invalid_handle;
  event->stream = stream;
  stream->work.emplace_back([event, time = ++event->recorded] {
    event->passed = time;
    return 0;
  });
  return 0;
}
Result cuEventSynchronize(void* handle) {
  FAKE_ENTER(fake().enter());
  Event* event = find(fake().events, handle, "event");
  if (event == nullptr) return invalid_handle;
  if (event->stream == nullptr) return 0;
  Stream& stream = *event->stream;
  while (event->passed < event->recorded && !stream.work.empty()) {
    (void)fake().drain(stream, stream.work.size() - 1);
    if (stream.failed != 0) return stream.failed;
  }
  return stream.failed;
}

Result cuMemsetD8Async(DevicePointer to, unsigned char value, std::size_t bytes, void* handle) {
  FAKE_ENTER(fake().enter());
  Stream* stream = find(fake().streams, handle, "stream");
  std::byte* host = fake().host(to, bytes);
  if (stream == nullptr || host == nullptr) return fake().broke("memset outside of memory", invalid_value);
  stream->work.emplace_back([=] {
    std::memset(host, value, bytes);
    return 0;
  });
  return 0;
}
Result cuMemcpyHtoDAsync_v2(DevicePointer to, const void* from, std::size_t bytes, void* handle) {
  FAKE_ENTER(fake().enter());
  Stream* stream = find(fake().streams, handle, "stream");
  std::byte* host = fake().host(to, bytes);
  if (stream == nullptr || host == nullptr) return fake().broke("a copy to outside of memory", invalid_value);
  if (!fake().is_pinned(from, bytes)) return fake().broke("a copy from memory that is not pinned", invalid_value);
  stream->work.emplace_back([=] {
    std::memcpy(host, from, bytes);
    return 0;
  });
  return 0;
}
Result cuMemcpyDtoHAsync_v2(void* to, DevicePointer from, std::size_t bytes, void* handle) {
  FAKE_ENTER(fake().enter());
  Stream* stream = find(fake().streams, handle, "stream");
  const std::byte* host = fake().host(from, bytes);
  if (stream == nullptr || host == nullptr) return fake().broke("a copy from outside of memory", invalid_value);
  if (!fake().is_pinned(to, bytes)) return fake().broke("a copy to memory that is not pinned", invalid_value);
  stream->work.emplace_back([=] {
    std::memcpy(to, host, bytes);
    return 0;
  });
  return 0;
}

/// An image is what the fake NVRTC writes: "fake cubin sm_90", then a line "NAME=VALUE" for each macro.
Result cuModuleLoadDataEx(void** handle, const void* image, unsigned, int*, void**) {
  FAKE_ENTER(fake().enter());
  const std::string text = static_cast<const char*>(image);
  const std::string cubin = "fake cubin sm_", ptx = "fake ptx compute_";
  const bool is_cubin = text.starts_with(cubin);
  if (!is_cubin && !text.starts_with(ptx)) return invalid_image;
  const int target = std::atoi(text.c_str() + (is_cubin ? cubin : ptx).size());
  if (is_cubin ? target != capability : target > capability) return wrong_architecture;
  Module* module = add(fake().modules);
  for (std::size_t begin = text.find('\n') + 1; begin < text.size();) {
    const std::size_t end = text.find('\n', begin);
    const std::size_t equals = text.find('=', begin);
    module->macros[text.substr(begin, equals - begin)] = std::atoi(text.c_str() + equals + 1);
    begin = end + 1;
  }
  if (module->macros["WORKGROUP"] != 256) return fake().broke("WORKGROUP is not 256", invalid_image);
  module->macros.erase("WORKGROUP");
  *handle = module;
  return 0;
}
Result cuModuleUnload(void* handle) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  fake().drain_all();
  if (fake().modules.erase(handle) == 0) return fake().broke("a module unloaded that is not there", invalid_handle);
  return result;
}
Result cuModuleGetFunction(void** function, void* handle, const char* name) {
  FAKE_ENTER(fake().enter());
  Module* module = find(fake().modules, handle, "module");
  if (module == nullptr) return invalid_handle;
  const auto* compiled = cuda_on_cpu::find("", name, module->macros);
  if (compiled == nullptr) return not_found;
  *function = module->functions.emplace_back(std::make_unique<Function>(Function{compiled})).get();
  return 0;
}
Result cuLaunchKernel(void* function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x,
                      unsigned block_y, unsigned block_z, unsigned shared_bytes, void* handle, void** parameters,
                      void**) {
  FAKE_ENTER(fake().enter());
  Stream* stream = find(fake().streams, handle, "stream");
  if (stream == nullptr) return invalid_handle;
  if (grid_x == 0 || grid_x > 0x7FFFFFFFU || grid_y * grid_z != 1 || block_x != 256 || block_y * block_z != 1 ||
      shared_bytes != 0) {
    return fake().broke("a launch of an odd shape", invalid_value);
  }
  const cuda_on_cpu::Compiled& compiled = *static_cast<Function*>(function)->compiled;
  auto copied = std::make_shared<Parameters>();
  if (const Result result = copy_parameters(compiled, parameters, *copied); result != 0) return result;
  ++fake().kernels;
  stream->work.emplace_back([&compiled, copied, grid_x, block_x] {
    try {
      cuda_on_cpu::run(compiled, grid_x, block_x, copied->places.data());
      return 0;
    } catch (const std::runtime_error& error) {
      return fake().broke(error.what(), launch_failed);
    }
  });
  return 0;
}
}
