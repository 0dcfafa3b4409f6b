#include "interflect/peers/opencl_place.h"

#include <fmt/format.h>

#include <array>
#include <bit>

#include "interflect/base/error.h"

namespace interflect::peers {

using opencl::succeed;

OpenClPlace::OpenClPlace(const Problem& given, const std::string& device_id) : problem(given), id(device_id) {
  const std::vector<opencl::Found> all = opencl::find_devices();
  const std::size_t index = index_of(id);
  if (index >= all.size() || all[index].device == nullptr) throw Error(ErrorKind::limit, "no device " + id);
  device = all[index].device;
  const std::array<cl_context_properties, 3> properties{CL_CONTEXT_PLATFORM,
                                                        std::bit_cast<cl_context_properties>(all[index].platform), 0};
  cl_int code = CL_SUCCESS;
  context.reset(clCreateContext(properties.data(), 1, &device, nullptr, nullptr, &code));
  succeed(code, id, "peer", "clCreateContext");
  queue.reset(clCreateCommandQueue(context.get(), device, 0, &code));
  succeed(code, id, "peer", "clCreateCommandQueue");
  const bool in_place = opencl::number_of<cl_device_type>(device, CL_DEVICE_TYPE) == CL_DEVICE_TYPE_CPU;
  const auto largest = opencl::number_of<cl_ulong>(device, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
  for (const Panel& panel : problem.f().panels()) {
    const std::size_t bytes = std::size_t{panel.rows} * problem.f().stride() * sizeof(float);
    if (bytes > largest) {
      throw Error(ErrorKind::limit,
                  fmt::format("a panel of {} bytes exceeds the device's largest buffer of {}", bytes, largest));
    }
    panels.push_back({panel.first, panel.rows,
                      memory(CL_MEM_READ_ONLY | (in_place ? CL_MEM_USE_HOST_PTR : CL_MEM_COPY_HOST_PTR), bytes,
                             panel.data->data())});
  }
  const std::size_t whole = problem.n() * problem.f().stride() * sizeof(float);
  if (const float* f = whole <= largest ? problem.f_by_columns() : nullptr) {
    f_by_columns = memory(CL_MEM_READ_ONLY | (in_place ? CL_MEM_USE_HOST_PTR : CL_MEM_COPY_HOST_PTR), whole, f);
  }
  const std::size_t bytes = columns * problem.n() * sizeof(float);
  x_by_columns = memory(CL_MEM_READ_ONLY | CL_MEM_COPY_HOST_PTR, bytes, problem.x_by_columns().data());
  x_by_rows = memory(CL_MEM_READ_ONLY | CL_MEM_COPY_HOST_PTR, bytes, problem.x_by_rows().data());
  const std::vector<float> zeros(columns * problem.n());
  y = memory(CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR, bytes, zeros.data());
}

opencl::Memory OpenClPlace::memory(cl_mem_flags flags, std::size_t bytes, const void* data) const {
  cl_int code = CL_SUCCESS;
  opencl::Memory made(clCreateBuffer(context.get(), flags, bytes, const_cast<void*>(data), &code));
  succeed(code, id, "peer", "clCreateBuffer");
  return made;
}

void OpenClPlace::wait() const {
  succeed(clFinish(queue.get()), id, "peer", "clFinish");
}

std::vector<float> OpenClPlace::download() const {
  std::vector<float> values(columns * problem.n());
  succeed(clEnqueueReadBuffer(queue.get(), y.get(), CL_TRUE, 0, values.size() * sizeof(float), values.data(), 0,
                              nullptr, nullptr),
          id, "peer", "clEnqueueReadBuffer");
  return values;
}

}  // namespace interflect::peers
