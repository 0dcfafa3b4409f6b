#include "device/fake_cuda/fake_state.h"

namespace interflect::fake_cuda {

thread_local void* Fake::current = nullptr;

Fake& fake() {
  static Fake one;
  return one;
}

}  // namespace interflect::fake_cuda

using namespace interflect::fake_cuda;

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
  if (--f.contexts == 0 && !(f.memory.empty() && f.pinned.empty() && f.streams.empty() && f.events.empty() &&
                             f.modules.empty() && f.graphs.empty() && f.executables.empty())) {
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
}
