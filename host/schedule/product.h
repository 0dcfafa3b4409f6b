#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "interflect/base/timer.h"
#include "interflect/device/device.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/packed_matrix.h"
#include "interflect/formfactor/streamed_matrix.h"
#include "interflect/schedule/balance.h"
#include "interflect/schedule/columns.h"
#include "interflect/schedule/device_matrix.h"
#include "interflect/schedule/device_share.h"

namespace interflect {

/// y = F x on one device, for one storage format: F's panels as they lie there and the kernels that apply them. What a
/// Scheduler is made of; nobody else uses it.
class Product {
 public:
  Product(const Product&) = delete;
  Product& operator=(const Product&) = delete;
  virtual ~Product() = default;

  /// Bytes that place() will allocate on the device; panels in shared host memory need none.
  [[nodiscard]] virtual std::uint64_t needed_bytes() const = 0;
  /// Compiles the kernels, allocates and uploads. Throws device Errors.
  virtual void place() = 0;
  /// From now on vectors have that shape: no more columns than at first. Compiles what is compiled for a number of
  /// columns, once for each. Throws device Errors.
  virtual void use(const VectorArguments& shape, std::uint32_t groups) {
    shape_ = shape;
    groups_ = groups;
    std::unique_ptr<Kernel>& kernel = multiply_[shape.columns];
    if (kernel == nullptr) kernel = compile_multiply();
  }
  /// Enqueues y = F x over vectors of the Scheduler's shape, by place (order()).
  virtual void apply(Buffer& x, Buffer& y) = 0;
  /// The elements of F on the device.
  [[nodiscard]] virtual std::vector<Buffer*> panel_buffers() const = 0;

  [[nodiscard]] virtual Storage storage() const = 0;
  [[nodiscard]] virtual std::uint64_t bytes() const = 0;  ///< of F as it is stored
  /// order()[k] is the patch at place k of a vector; empty: patch k.
  [[nodiscard]] virtual std::span<const std::uint32_t> order() const { return {}; }
  /// F x of the stored matrix in double, by patch.
  virtual void exact(const Columns& x, std::vector<std::vector<double>>& y) const = 0;

  /// What each device of several does of it, and those that were lost; empty for one device.
  [[nodiscard]] virtual std::vector<DeviceShare> device_shares() const { return {}; }
  [[nodiscard]] virtual std::vector<DeviceFailure> failures() const { return {}; }
  /// What comes down from the device for a decision: of several ranks rank 0's, where their devices differ.
  virtual void agree(std::span<float> /*values*/) {}

  [[nodiscard]] std::uint64_t uploaded_bytes() const { return uploaded_bytes_; }
  [[nodiscard]] double compile_seconds() const { return compile_seconds_; }

 protected:
  /// `shape` has n, vector_stride, columns and blocks of the vectors, and the launch shape of vector kernels.
  Product(Device& device, const VectorArguments& shape, std::uint32_t groups)
      : device_(device), shape_(shape), groups_(groups), most_columns_(shape.columns) {}

  /// The kernel that multiplies so many columns(): a kernel of its own for each number.
  [[nodiscard]] virtual std::unique_ptr<Kernel> compile_multiply() = 0;
  [[nodiscard]] const Kernel& multiply_kernel() const { return *multiply_.at(shape_.columns); }
  /// The macros with the number of columns() in use.
  [[nodiscard]] Macros with_columns(Macros macros) const {
    macros.insert_or_assign("COLUMNS", columns());
    return macros;
  }

  [[nodiscard]] std::unique_ptr<Kernel> compiled(std::string_view name, const Macros& macros) {
    const Timer timer;
    auto kernel = device_.kernel(name, macros);
    compile_seconds_ += timer.seconds();
    return kernel;
  }
  [[nodiscard]] std::unique_ptr<Buffer> uploaded(std::span<const std::byte> bytes) {
    auto buffer = device_.allocate(bytes.size());
    device_.queue().upload(*buffer, 0, bytes);
    return buffer;
  }
  template <class Arguments>
  void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers, const Arguments& arguments,
              std::string_view label) {
    device_.queue().launch(kernel, groups, buffers, std::as_bytes(std::span(&arguments, 1)), label);
  }
  [[nodiscard]] int columns() const { return static_cast<int>(shape_.columns); }

  Device& device_;
  VectorArguments shape_;
  std::uint32_t groups_;
  std::uint32_t most_columns_;  ///< those for which it was placed
  std::uint64_t uploaded_bytes_ = 0;
  double compile_seconds_ = 0;

 private:
  std::map<std::uint32_t, std::unique_ptr<Kernel>> multiply_;  ///< by the number of columns
};

/// How F can be cut for several devices: into units that follow each other.
struct Division {
  std::vector<std::uint64_t> bytes;   ///< of F before each unit, and all
  std::vector<std::uint32_t> places;  ///< each unit's first place in y, and the end of the last one's
  /// A unit reaches all of y: the devices' results are added up (sym16).
  bool added = false;
  [[nodiscard]] std::uint32_t units() const { return static_cast<std::uint32_t>(bytes.size() - 1); }
};
[[nodiscard]] Division division_of(const FormFactorMatrix& form_factors);
[[nodiscard]] Division division_of(const PackedMatrix& form_factors);

/// A Product that can be one device's part of F x.
class PartProduct : public Product {
 public:
  /// Whether F is used where the host has it, so that no part takes memory of the device.
  [[nodiscard]] virtual bool in_place() const = 0;
  /// The units [first, end) from now on; apply() leaves y as it is at other places, or adds nothing there. place() then
  /// brings what is not on the device yet. No unit: apply() must not be called.
  virtual void take(std::uint32_t first, std::uint32_t end) = 0;

 protected:
  using Product::Product;
};

/// A part that has no units yet. What is given must outlive it.
[[nodiscard]] std::unique_ptr<PartProduct> make_part(const FormFactorMatrix& form_factors, Device& device,
                                                     const VectorArguments& shape, std::uint32_t groups);
[[nodiscard]] std::unique_ptr<PartProduct> make_part(const PackedMatrix& form_factors, Device& device,
                                                     const VectorArguments& shape, std::uint32_t groups);

/// The most rows of a panel of n columns that a launch of matvec takes on the device, by its largest buffer and its
/// number of groups of `group` rows: whole groups where they do not all fit and there is one. Throws a limit Error
/// where one row is too large.
[[nodiscard]] std::uint32_t rows_of_a_launch(const DeviceInfo& device, std::uint32_t n, std::uint32_t stride,
                                             std::uint32_t group);

/// Plans where F's panels go, without allocating. Throws a limit Error where one row (strip, block) exceeds the
/// device's largest buffer. The matrix must outlive the Product.
[[nodiscard]] std::unique_ptr<Product> make_product(const FormFactorMatrix& form_factors, Device& device,
                                                    const VectorArguments& shape, std::uint32_t groups);
[[nodiscard]] std::unique_ptr<Product> make_product(const PackedMatrix& form_factors, Device& device,
                                                    const VectorArguments& shape, std::uint32_t groups);
[[nodiscard]] std::unique_ptr<Product> make_product(const StreamedMatrix& form_factors, Device& device,
                                                    const VectorArguments& shape, std::uint32_t groups);

/// A SplitProduct (split_product.h) over several devices, the first of which has the vectors.
[[nodiscard]] std::unique_ptr<Product> make_split_product(const FormFactorMatrix& form_factors,
                                                          const std::vector<Device*>& devices,
                                                          const VectorArguments& shape, std::uint32_t groups,
                                                          const SplitOptions& options);
[[nodiscard]] std::unique_ptr<Product> make_split_product(const PackedMatrix& form_factors,
                                                          const std::vector<Device*>& devices,
                                                          const VectorArguments& shape, std::uint32_t groups,
                                                          const SplitOptions& options);

/// F that lies on the device already.
[[nodiscard]] std::unique_ptr<Product> make_product(DeviceMatrix matrix, Device& device, const VectorArguments& shape,
                                                    std::uint32_t groups);

}  // namespace interflect
