#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/columns.h"

namespace interflect {

/// A dense32 matrix of n x n in buffers of one device, by panels of whole tile rows, that never was on the host. Knows
/// the device by its buffers only: it must be gone before the device.
class DeviceMatrix {
 public:
  struct Panel {
    std::uint32_t first = 0, rows = 0;  ///< rows: a multiple of 32, but for the last panel
    std::unique_ptr<Buffer> buffer;     ///< rows * stride() floats, row-major
  };

  DeviceMatrix() = default;
  /// Allocates zeroed panels, none larger than the device's buffers, launches of its kernels, or max_panel_bytes allow.
  /// Throws a limit Error, before anything is allocated, where that is less than 32 rows; device Errors.
  DeviceMatrix(Device& device, std::uint32_t n,
               std::uint64_t max_panel_bytes = FormFactorMatrix::default_panel_bytes());

  [[nodiscard]] std::uint32_t size() const { return n_; }
  [[nodiscard]] std::uint32_t stride() const { return stride_; }  ///< elements from one row to the next
  [[nodiscard]] std::uint64_t bytes() const { return std::uint64_t{n_} * stride_ * sizeof(float); }
  [[nodiscard]] const std::vector<Panel>& panels() const { return panels_; }

  /// Copies it to the host, on whose device it is.
  [[nodiscard]] FormFactorMatrix download(Device& device) const;

 private:
  std::uint32_t n_ = 0, stride_ = 0;
  std::vector<Panel> panels_;
};

/// F x of a DeviceMatrix to about 3e-11 (kernels/README.md, matvec_exact) for `columns` columns of n values: what the
/// residual and the energy balance in double need where the host has no F. Matrix and device must outlive it.
class DeviceExactProduct {
 public:
  /// Compiles, and allocates x and y. `compile` makes a kernel, so that a caller can time it; null: the device does.
  using Compile = std::function<std::unique_ptr<Kernel>(std::string_view name, const Macros& macros)>;
  DeviceExactProduct(Device& device, const DeviceMatrix& matrix, std::uint32_t columns, const Compile& compile = {});

  /// Waits for the result. Throws an internal Error for columns of another length or number; device Errors.
  void apply(const Columns& x, std::vector<std::vector<double>>& y);

  /// Of the vectors that it allocates.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t stride, std::uint32_t columns) {
    return std::uint64_t{3} * columns * stride * sizeof(float);
  }

 private:
  Device& device_;
  const DeviceMatrix& matrix_;
  std::uint32_t columns_;
  std::unique_ptr<Kernel> kernel_;
  std::unique_ptr<Buffer> x_, y_;
  std::vector<float> staging_;
};

}  // namespace interflect
