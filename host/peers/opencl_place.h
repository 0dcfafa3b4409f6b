#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "interflect/device/opencl/api.h"
#include "interflect/peers/peer.h"

namespace interflect::peers {

/// F by its panels and X, Y on an OpenCL device, for the libraries that take cl_mem. A device that is a processor uses
/// F where it lies.
class OpenClPlace {
 public:
  /// Throws a limit Error when a panel is larger than the device's buffers, device Errors.
  OpenClPlace(const Problem& problem, const std::string& id);

  struct Rows {
    std::size_t first, rows;
    opencl::Memory f;
  };
  const Problem& problem;
  std::string id;
  cl_device_id device = nullptr;
  opencl::Context context;
  opencl::CommandQueue queue;
  std::vector<Rows> panels;
  opencl::Memory f_by_columns;  ///< null where the problem has none or the device's largest buffer is too small
  opencl::Memory x_by_columns, x_by_rows, y;

  /// Returns when everything enqueued is done.
  void wait() const;
  /// The 3 n floats of Y.
  [[nodiscard]] std::vector<float> download() const;

 private:
  [[nodiscard]] opencl::Memory memory(cl_mem_flags flags, std::size_t bytes, const void* data) const;
};

}  // namespace interflect::peers
