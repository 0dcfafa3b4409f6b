#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "bench_row.h"
#include "interflect/base/progress.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "study.h"

namespace interflect::cli {

/// What is measured with, everywhere.
struct BenchPlan {
  std::string folder;  ///< with the rooms
  std::vector<std::string> devices;
  std::vector<Storage> storages;
  unsigned repetitions = 15;
  bool peers = false;  ///< other people's libraries do the products of the rooms in the same passes (bench_peers.h)
  std::uint32_t block = 0;  ///< of sym16; 0: PackedMatrix's own choice
};
/// Takes rows as they are finished.
using RowSink = std::function<void(const std::vector<BenchRow>&)>;

/// What needs no scene, on every device in turn: read and copy over large buffers, a launch (enqueued by the hundred,
/// and waited for one by one as "launch+wait"), the vector kernels over vectors that no cache holds.
[[nodiscard]] std::vector<BenchRow> bench_devices(const std::vector<std::string>& devices, unsigned repetitions);

/// The rate of a device's "read" or "copy" among verified rows that need no scene; 0 when it is not there.
[[nodiscard]] double device_rate(const std::vector<BenchRow>& rows, const std::string& device, std::string_view what);
/// The least seconds of its "launch": what disturbs one is not its own.
[[nodiscard]] double launch_seconds(const std::vector<BenchRow>& rows, const std::string& device);

/// Rows for one room on every device in turn: placing F (upload, and compile where the device has a compiler), the read
/// bandwidth over the dense matrix; per storage the matvec and a solve per method. F is placed once on each device.
/// `measured` are the rows of bench_devices().
[[nodiscard]] std::vector<BenchRow> bench_room(const BenchPlan& plan, const Room& room,
                                               const std::vector<BenchRow>& measured, ProgressSink& progress);

/// The same products of a dense, symmetric, random matrix of n patches, in which no tile is empty. It is not solved: it
/// is nearly of rank one, which flatters every method.
[[nodiscard]] std::vector<BenchRow> bench_random(const BenchPlan& plan, std::uint32_t n,
                                                 const std::vector<BenchRow>& measured);

/// That matrix: values between 0.5/n and 1.5/n, the same for (i, j) and (j, i).
[[nodiscard]] FormFactorMatrix random_form_factors(std::uint32_t n);

/// "growth" rows: a product per storage and device for one room cut into about 1k, 2k, 4k, ... patches, none above
/// `most`. A size that does not fit into memory is a row with the reason.
void bench_growth(const BenchPlan& plan, std::uint32_t most, const std::vector<BenchRow>& measured,
                  ProgressSink& progress, const RowSink& sink);

}  // namespace interflect::cli
