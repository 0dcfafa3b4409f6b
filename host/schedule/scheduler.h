#pragma once

#include <cstdint>
#include <initializer_list>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/ranks.h"
#include "interflect/device/device.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/packed_matrix.h"
#include "interflect/formfactor/streamed_matrix.h"
#include "interflect/schedule/balance.h"
#include "interflect/schedule/columns.h"
#include "interflect/schedule/device_share.h"

namespace interflect {

/// y = F x with every product and sum in double, on the host, from F as it is stored: any number of columns of N
/// values. Independent of the devices, it is what a result is checked against. The same bits for every number of
/// threads. Throws an internal Error for a column of another length.
void exact_product(const FormFactorMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y);
/// The same for F as 16 bits have rounded it; x and y by patch.
void exact_product(const PackedMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y);
/// The same for F over panels that need not be in memory: a pass over them. Throws what reading throws.
void exact_product(const StreamedMatrix& form_factors, const Columns& x, std::vector<std::vector<double>>& y);

class DeviceFormFactors;
class Product;

/// C columns of n floats on the devices (stride padded to a multiple of 16), or a sums buffer. Made by a Scheduler, and
/// gone with it: a Vector must not outlive its Scheduler.
class Vector {
  friend class Scheduler;
  explicit Vector(std::unique_ptr<Buffer> buffer) : buffer_(std::move(buffer)) {}
  std::unique_ptr<Buffer> buffer_;
};

/// A vector kernel of kernels/, compiled for the devices. Must not outlive its Scheduler.
class VectorKernel {
  friend class Scheduler;
  explicit VectorKernel(std::shared_ptr<const Kernel> kernel) : kernel_(std::move(kernel)) {}
  std::shared_ptr<const Kernel> kernel_;
};

/// Places the panels of F on devices, applies F across them, and owns their queues: what a solver knows of an operator
/// and of vectors. Work is enqueued and runs in order; only download() and wait() wait for it.
class Scheduler {
 public:
  /// Places every panel: in place where the device shares host memory and the panel is within its limits; else cut by
  /// rows into panels that fit the device's largest buffer and its work-groups, allocated and uploaded. F must outlive
  /// the Scheduler and stay unchanged. `columns` is the C of every vector.
  /// Several devices share F's rows (SplitProduct), and the first has the vectors. One of the others that fails, or has
  /// no room, is left out: failures(). What is thrown comes from the first.
  /// Throws a usage Error for no patches, no columns, or no device; a limit Error, before anything is
  /// allocated, when panels and vectors exceed the device's memory or one row or vector exceeds its largest buffer;
  /// device Errors.
  Scheduler(const FormFactorMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices, std::uint32_t columns,
            const SplitOptions& split = {});
  /// The same for one of several ranks, whose matrix has that rank's rows (FormFactorMatrix::rows_only): every rank has
  /// whole vectors, and gets the rows of y from the others. Collective, as are apply() and exact_product(), and, where
  /// the ranks' devices differ, download(): then all have what rank 0 has. A device Error of one rank in placing is an
  /// AgreedError of all.
  Scheduler(const FormFactorMatrix& rows, Ranks& ranks, std::vector<std::unique_ptr<Device>> devices,
            std::uint32_t columns, const SplitOptions& split = {});
  /// The same with these rows as dense16 or tiled16 have them.
  Scheduler(const PackedMatrix& packed, const FormFactorMatrix& rows, Ranks& ranks,
            std::vector<std::unique_ptr<Device>> devices, std::uint32_t columns, const SplitOptions& split = {});
  /// The same for a 16-bit format: panels of strips or blocks. Vectors then lie in the matrix's own order of patches;
  /// upload() and download() take and give columns by patch.
  Scheduler(const PackedMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices, std::uint32_t columns,
            const SplitOptions& split = {});
  /// F where a device has assembled it: takes the device and F, places nothing. exact_product() then comes from the
  /// device too, to about 3e-11 of the sum of what was added.
  Scheduler(DeviceFormFactors form_factors, std::uint32_t columns);
  /// The same for panels of S that need not be in memory: those that fit stay, where the device uses them (on a device
  /// with memory of its own as many as fit both), the others stream through every product. apply() throws what reading
  /// them throws.
  Scheduler(const StreamedMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices, std::uint32_t columns);
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;
  ~Scheduler();

  [[nodiscard]] std::uint32_t size() const { return arguments_.n; }                ///< N, patches
  [[nodiscard]] std::uint32_t columns() const { return arguments_.columns; }       ///< C
  [[nodiscard]] std::uint32_t most_columns() const { return most_columns_; }       ///< the C it was made with
  [[nodiscard]] std::uint32_t stride() const { return arguments_.vector_stride; }  ///< of a Vector's columns, in floats
  [[nodiscard]] std::uint32_t blocks() const { return arguments_.blocks; }         ///< partial sums per column
  [[nodiscard]] Storage storage() const;                                           ///< how F is stored
  [[nodiscard]] std::uint64_t bytes() const;                                       ///< of F as it is stored
  [[nodiscard]] std::vector<std::string> device_ids() const;                       ///< of those that have not been lost
  [[nodiscard]] Device& device() { return *device_; }                              ///< the one with the vectors
  /// What each of several devices does, and those of them that were lost; empty for one.
  [[nodiscard]] std::vector<DeviceShare> shares() const;
  [[nodiscard]] std::vector<DeviceFailure> failures() const;
  /// The panels of F as they lie on the device: only to be read, and gone with the Scheduler.
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const;
  /// Bytes of F that were copied to devices (0 where they use the host's memory in place).
  [[nodiscard]] std::uint64_t uploaded_bytes() const;
  /// Applications of F so far: apply() and exact_product() each count one.
  [[nodiscard]] std::uint64_t products() const { return products_; }

  /// From now on C is `columns`, at most most_columns(): a product of fewer columns costs less. Vectors and sums made
  /// with another C must no longer be used. What is compiled for a number of columns is compiled once for each. Throws
  /// an internal Error for no columns or too many, and device Errors.
  void use_columns(std::uint32_t columns);

  /// A zeroed vector of C columns.
  [[nodiscard]] Vector vector();
  /// A zeroed sums buffer: the scalar slots and partial sums of kernel_arguments.h.
  [[nodiscard]] Vector sums();
  /// The vector kernel `name` of kernels/README.md, compiled once and kept. Throws a device Error for an unknown one.
  [[nodiscard]] VectorKernel kernel(std::string_view name);
  /// Seconds spent so far in the device's compiler, or in loading what it compiled before.
  [[nodiscard]] double compile_seconds() const;

  /// Host columns (C of N values) to a vector. Throws an internal Error for another shape.
  void upload(Vector& to, const Columns& from);
  /// Floats to the head of a buffer, such as the scalar slots of a sums buffer.
  void upload(Vector& to, std::span<const float> from);
  /// A vector to host columns, resized to C of N values. Waits.
  void download(const Vector& from, Columns& to);
  /// The head of a buffer. Waits: the one synchronisation that an iteration needs.
  void download(const Vector& from, std::span<float> to);

  /// y = F x of the stored F, panel by panel. x and y are different vectors.
  void apply(Vector& x, Vector& y);
  /// Enqueues a vector kernel over its buffers in the contract's order. `option` and `slot` as in VectorArguments.
  void run(const VectorKernel& kernel, std::initializer_list<Vector*> buffers, std::string_view label,
           std::uint32_t option = 0, std::uint32_t slot = 0);
  /// Returns when everything enqueued is done.
  void wait();

  /// The free exact_product() of this F, counted. Throws an internal Error for other than C columns of N values.
  void exact_product(const Columns& x, std::vector<std::vector<double>>& y);

 private:
  Scheduler(std::vector<std::unique_ptr<Device>> devices, std::uint32_t size, std::uint32_t columns);
  void shape(std::uint32_t columns);
  void check_memory() const;
  void place();

  std::vector<std::unique_ptr<Device>> devices_;
  Device* device_ = nullptr;
  VectorArguments arguments_;
  std::uint32_t groups_ = 0;
  std::uint32_t most_columns_ = 0;
  std::unique_ptr<Product> product_;
  std::map<std::string, std::shared_ptr<const Kernel>, std::less<>> kernels_;
  std::vector<float> staging_;
  std::uint64_t products_ = 0;
  double compile_seconds_ = 0;
};

}  // namespace interflect
