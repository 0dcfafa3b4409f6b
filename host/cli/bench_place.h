#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bench_row.h"
#include "bench_stored.h"
#include "counting_device.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/compile_cache.h"
#include "measurement.h"
#include "pipeline.h"

namespace interflect::cli {

inline constexpr std::uint32_t bench_channels = 3;

/// What every product is measured with: columns of positive numbers.
[[nodiscard]] Columns test_vector(std::uint32_t n);

/// A device with F on it, vectors, and what placing it took.
class Place {
 public:
  /// Opens the device and places F; throws what that throws.
  Place(const std::string& id, const Stored& matrix);

  [[nodiscard]] Scheduler& scheduler() { return *scheduler_; }
  [[nodiscard]] const DeviceInfo& info() const { return device_->info(); }
  [[nodiscard]] std::uint64_t launches() const { return device_->launches(); }
  /// Of F: allocating and copying, or sharing, without the compiler.
  [[nodiscard]] double upload_seconds() const { return upload_seconds_; }
  /// The matvec and what the solvers run over vectors: compiled, or loaded from the cache.
  [[nodiscard]] double compile_seconds() const { return scheduler_->compile_seconds(); }
  [[nodiscard]] const CompileStatistics& compiled() const { return compiled_; }
  /// Over the panels of dense32; none for others, whose elements are no floats.
  [[nodiscard]] std::vector<Reader>& readers() { return readers_; }
  /// What the kernels' contract allows an element of a product.
  [[nodiscard]] double bound() const { return bound_; }
  [[nodiscard]] Vector& x() { return x_; }
  [[nodiscard]] Vector& y() { return y_; }

 private:
  CountingDevice* device_ = nullptr;  ///< the Scheduler's
  double upload_seconds_ = 0, bound_ = 0;
  CompileStatistics compiled_ = compile_statistics();  ///< of before; then of this place alone
  std::unique_ptr<Scheduler> scheduler_;
  std::vector<Reader> readers_;
  Vector x_, y_;
};
using SharedPlace = std::shared_ptr<Place>;

/// The read kernel over dense32 as it lies on the device, the best of the stream counts in every pass; the sums are
/// held against `exact`, that of all form factors in double.
[[nodiscard]] Timed reading(const SharedPlace& place, double exact);

/// One product of F with three columns; held against the product in double within the kernel's own bound.
[[nodiscard]] Timed multiplying(const SharedPlace& place);

/// Judges the product that the place computed last: fills error and bound, denies the row when it is wrong.
void verify_product(BenchRow& row, Place& place);

}  // namespace interflect::cli
