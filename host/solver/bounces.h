#pragma once

#include <cstdint>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

/// What the light is after 0, 1, ... `count` bounces: element k is Σ_{m<=k} (diag(ρ) F)^m e for every column, so that
/// element 0 is e, and element k what Jacobi's k iterations give. In single precision, a product for every bounce, in
/// batches of the Scheduler's most_columns(); it is left with the columns of the last batch. Of `reflectance` there may
/// be fewer columns, which are then used over and over (BatchedSolve). Throws a usage Error for other shapes, an input
/// Error for an emittance that is not finite or a reflectance outside [0, 1], and what the device throws.
[[nodiscard]] std::vector<Columns> bounce_series(Scheduler& scheduler, const Columns& reflectance,
                                                 const Columns& emittance, std::uint32_t count,
                                                 ProgressSink* progress = nullptr);

}  // namespace interflect
