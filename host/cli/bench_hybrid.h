#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bench_row.h"

namespace interflect::cli {

/// Devices that work together, on products of a dense random matrix of n patches: each alone, in turn with all of them
/// together, whose row says how many times the ideal time it took, 1 / Σ 1 / (each alone), in the median of the passes.
/// First a pair of slowed devices (SlowedDevice) of which one has a quarter of the other's rate; then the devices
/// themselves, if there are several. What was learnt before the first timed pass is part of no time.
[[nodiscard]] std::vector<BenchRow> bench_hybrid(const std::vector<std::string>& devices, std::uint32_t n,
                                                 unsigned repetitions);

}  // namespace interflect::cli
