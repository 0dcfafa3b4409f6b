#include "interflect/peers/cuda_place.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "interflect/base/error.h"

namespace interflect::peers {

namespace {

constexpr std::size_t staging_bytes = std::size_t{16} << 20;

const cuda::Driver& driver() {
  std::string reason;
  if (const cuda::Driver* found = cuda::Driver::open(reason)) return *found;
  throw Error(ErrorKind::limit, reason);
}

int device_of(const std::string& id) {
  int count = 0, device = 0;
  const std::size_t index = index_of(id);
  const auto check = [&](cuda::Result result, const char* function) {
    if (result != 0) throw device_error(id, "peer", driver().text(result, function));
  };
  check(driver().device_count(&count), "cuDeviceGetCount");
  if (index >= static_cast<std::size_t>(count)) throw Error(ErrorKind::limit, "no device " + id);
  check(driver().device_get(&device, static_cast<int>(index)), "cuDeviceGet");
  return device;
}

}  // namespace

CudaPlace::CudaPlace(const Problem& given, const std::string& id)
    : problem(given), session_(driver(), id, device_of(id)) {
  use();
  cuda::Stream* stream = nullptr;
  session_.check(session_.cuda.stream_create(&stream, cuda::stream_non_blocking), "peer", "cuStreamCreate");
  stream_ = session_.owned(stream, session_.cuda.stream_destroy);
  x_by_columns = uploaded(std::as_bytes(std::span(problem.x_by_columns())));
  x_by_rows = uploaded(std::as_bytes(std::span(problem.x_by_rows())));
  const std::vector<float> zeros(columns * problem.n());
  y = uploaded(std::as_bytes(std::span(zeros)));
}

cuda::DevicePointer CudaPlace::allocate(std::size_t bytes) {
  cuda::DevicePointer memory = 0;
  session_.check(session_.cuda.memory_allocate(&memory, bytes), "peer", "cuMemAlloc");
  memory_.emplace_back(&session_, memory);
  return memory;
}

CudaPlace::Pinned CudaPlace::pinned(std::size_t bytes) const {
  void* memory = nullptr;
  session_.check(session_.cuda.pinned_allocate(&memory, bytes, 0), "peer", "cuMemHostAlloc");
  return {memory, [free = session_.cuda.pinned_free](void* given) { free(given); }};
}

cuda::DevicePointer CudaPlace::uploaded(std::span<const std::byte> data) {
  const cuda::DevicePointer memory = allocate(data.size());
  const Pinned staging = pinned(std::min(data.size(), staging_bytes));
  for (std::size_t done = 0; done < data.size(); done += staging_bytes) {
    const std::size_t bytes = std::min(data.size() - done, staging_bytes);
    std::memcpy(staging.get(), data.data() + done, bytes);
    session_.check(session_.cuda.copy_in(memory + done, staging.get(), bytes, stream()), "peer", "cuMemcpyHtoDAsync");
    wait();
  }
  return memory;
}

void CudaPlace::upload_f() {
  for (const Panel& panel : problem.f().panels()) {
    const std::size_t bytes = std::size_t{panel.rows} * problem.f().stride() * sizeof(float);
    panels.push_back({panel.first, panel.rows, uploaded({panel.data->data(), bytes})});
  }
  if (const float* f = problem.f_by_columns()) {
    f_by_columns = uploaded(std::as_bytes(std::span(f, problem.n() * problem.f().stride())));
  }
}

void CudaPlace::wait() const {
  session_.check(session_.cuda.stream_wait(stream()), "peer", "cuStreamSynchronize");
}

std::vector<float> CudaPlace::download() const {
  use();
  std::vector<float> values(columns * problem.n());
  const std::size_t bytes = values.size() * sizeof(float);
  const Pinned staging = pinned(bytes);
  session_.check(session_.cuda.copy_out(staging.get(), y, bytes, stream()), "peer", "cuMemcpyDtoHAsync");
  wait();
  std::memcpy(values.data(), staging.get(), bytes);
  return values;
}

void CudaPlace::check(int status, const char* function) const {
  if (status != 0) throw device_error(session_.id, "peer", fmt::format("{} gave status {}", function, status));
}

}  // namespace interflect::peers
