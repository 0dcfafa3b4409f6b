#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/device/device.h"

namespace interflect {

enum class CheckStatus { pass, fail, unsupported };
[[nodiscard]] std::string_view name(CheckStatus status);

/// One kernel on one device for one case, held against the fp64 reference (host/device/reference.h).
struct KernelCheck {
  std::string device;      ///< id
  std::string kernel;      ///< name in kernels/
  std::string parameters;  ///< macros and shape, as "COLUMNS=3 panel_rows=5 seed=..."
  std::uint64_t size = 0;  ///< n
  double error = 0;        ///< the largest |result - reference| / Σ|what was added|; NaN when a result is NaN
  double bound = 0;        ///< what kernels/README.md allows it to be
  CheckStatus status = CheckStatus::fail;
  std::string reason;  ///< why it failed or is unsupported; empty when passed
};

inline constexpr std::uint64_t every_size = std::numeric_limits<std::uint64_t>::max();

/// Runs every kernel of the device on every case of its description: sizes around the multiples of vectors, tiles and
/// work-groups, one and several panels, NaN in the padding, guard zones behind each buffer. Takes about a second on a
/// CPU. A DeviceError of a case is a failure with that reason; a limit of the device is `unsupported`. Throws nothing
/// of the device's. Cases of a larger n, or of more lines, than `max_size` are left out: for tools that run a kernel
/// thousands of times slower.
[[nodiscard]] std::vector<KernelCheck> check_device(Device& device, std::uint64_t max_size = every_size);

/// The relative error c u / (1 - c u), u = 2^-24, that kernels/README.md allows a matvec of n columns.
[[nodiscard]] double matvec_bound(std::uint64_t n);
/// What it allows hi + lo of matvec_exact: some 3e-11.
[[nodiscard]] double matvec_exact_bound(std::uint64_t n);
/// What it allows a row of tiles16 of n columns, and a partial sum of sym16 with blocks of `block` rows.
[[nodiscard]] double packed_bound(std::uint64_t n);
[[nodiscard]] double sym16_bound(std::uint64_t block);

}  // namespace interflect
