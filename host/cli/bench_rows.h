#pragma once

#include <string>
#include <vector>

#include "bench_row.h"
#include "interflect/base/progress.h"
#include "study.h"

namespace interflect::cli {

/// What needs no scene, on every device in turn: read and copy over large buffers, a launch (enqueued by the hundred,
/// and waited for one by one as "launch+wait"), dot and axpby over columns of a million elements.
[[nodiscard]] std::vector<BenchRow> bench_devices(const std::vector<std::string>& devices, unsigned repetitions);

/// Rows for one room on every device in turn: the read bandwidth over its matrix and the matvec, then a solve per
/// method. F is placed once on each device. With `with_peers` other people's libraries do the product in the same
/// passes (bench_peers.h).
[[nodiscard]] std::vector<BenchRow> bench_room(const std::string& folder, const Room& room,
                                               const std::vector<std::string>& devices, unsigned repetitions,
                                               bool with_peers, ProgressSink& progress);

}  // namespace interflect::cli
