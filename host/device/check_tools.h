#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "interflect/device/check.h"

// What the description of a kernel's check is made of. To add kernel NAME: write check_NAME.cpp with
// `void check_NAME(Device&, std::vector<KernelCheck>&, const Selection&)`, declare it below and add it to the
// list in check.cpp.

namespace interflect::check {

/// Numbers that are the same everywhere: uniform, with |value| in [0.5, 1.5), so that a single lost product stays above
/// every bound, and with random signs. (SplitMix64, Steele et al. 2014.)
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  [[nodiscard]] float next();
  [[nodiscard]] std::vector<float> numbers(std::size_t count);

 private:
  std::uint64_t state_;
};

/// The NaN that stands in padding and guard zones, and whether a value is it, bit for bit.
[[nodiscard]] float sentinel();
[[nodiscard]] bool is_sentinel(float value);

/// A buffer with sentinels in the 256 floats behind its values. Throws a limit Error when a buffer of the device cannot
/// be so large.
class GuardedBuffer {
 public:
  GuardedBuffer(Device& device, std::span<const float> values);
  [[nodiscard]] Buffer* get() const { return buffer_.get(); }
  /// The values now. Throws a device Error when the guard zone was written.
  [[nodiscard]] std::vector<float> values(Device& device) const;

 private:
  std::unique_ptr<Buffer> buffer_;
  std::size_t count_;
};

/// c u / (1 - c u) with u = 2^-24: the relative error of a sum of fp32 products whose unluckiest term is rounded c
/// times.
[[nodiscard]] double rounding_bound(std::uint64_t c);

/// What a case's run found: the largest error as in KernelCheck, and what else was wrong (empty: nothing).
struct Finding {
  double error = 0;
  std::string wrong;
};

/// Notes |result - reference| / magnitude in the finding; NaN stays.
void compare(Finding& finding, float result, double reference, double magnitude);

/// Runs a case and appends its row: pass when error <= bound and nothing was wrong; an Error of kind limit makes it
/// unsupported, any other a failure.
void add_case(std::vector<KernelCheck>& rows, KernelCheck row, const std::function<Finding()>& run);

/// Which cases are run: all, or those that a tool is slow enough to need few of, or a broken kernel is seen by.
struct Selection {
  std::uint64_t max_size = every_size;  ///< n, or lines, at most
  std::uint32_t columns = 0;            ///< of matvec, which is compiled for each number; 0: all
  std::string_view kernel = {};         ///< of the vector kernels and the 16-bit formats; empty: all
  /// Of matvec, tiles16 and sym16, in place of default_macros(); with BLOCK every case of sym16 has that block.
  Macros macros = {};
};
/// The macros of a case: default_macros(), those of the selection, and the number of columns.
[[nodiscard]] Macros case_macros(const DeviceInfo& device, std::string_view kernel, const Selection& selection,
                                 std::uint32_t columns);
void check_matvec(Device& device, std::vector<KernelCheck>& rows, const Selection& selection = {});
/// matvec_exact and close_rows.
void check_resident(Device& device, std::vector<KernelCheck>& rows, const Selection& selection = {});
void check_stream(Device& device, std::vector<KernelCheck>& rows, const Selection& selection = {});  ///< read and copy
/// tiles16, sym16, sym16_fold, scale.
void check_packed(Device& device, std::vector<KernelCheck>& rows, const Selection& selection = {});
/// dot, axpby, and the steps of the solvers.
void check_vectors(Device& device, std::vector<KernelCheck>& rows, const Selection& selection = {});
/// shadow_rays; the size is the number of triangles.
void check_rays(Device& device, std::vector<KernelCheck>& rows, const Selection& selection = {});

}  // namespace interflect::check
