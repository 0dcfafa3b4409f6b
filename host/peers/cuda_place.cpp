#include "interflect/peers/cuda_place.h"

#include <fmt/format.h>

#include "interflect/base/error.h"

namespace interflect::peers {

namespace {

const cuda::Driver& driver() {
  std::string reason;
  if (const cuda::Driver* found = cuda::Driver::open(reason)) return *found;
  throw Error(ErrorKind::limit, reason);
}

}  // namespace

CudaPlace::CudaPlace(const Problem& given, const std::string& id)
    : problem(given), session_(driver(), id, static_cast<int>(index_of(id))) {
  use();
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

cuda::DevicePointer CudaPlace::uploaded(std::span<const std::byte> data) {
  const cuda::DevicePointer memory = allocate(data.size());
  session_.check(session_.cuda.copy_in(memory, data.data(), data.size(), nullptr), "peer", "cuMemcpyHtoDAsync");
  wait();
  return memory;
}

void CudaPlace::upload_f() {
  for (const Panel& panel : problem.f().panels()) {
    const std::size_t bytes = std::size_t{panel.rows} * problem.f().stride() * sizeof(float);
    panels.push_back({panel.first, panel.rows, uploaded({panel.data->data(), bytes})});
  }
}

void CudaPlace::wait() const {
  session_.check(session_.cuda.stream_wait(nullptr), "peer", "cuStreamSynchronize");
}

std::vector<float> CudaPlace::download() const {
  use();
  std::vector<float> values(columns * problem.n());
  session_.check(session_.cuda.copy_out(values.data(), y, values.size() * sizeof(float), nullptr), "peer",
                 "cuMemcpyDtoHAsync");
  wait();
  return values;
}

void CudaPlace::check(int status, const char* function) const {
  if (status != 0) throw device_error(session_.id, "peer", fmt::format("{} gave status {}", function, status));
}

}  // namespace interflect::peers
