#pragma once

#include <string>

#include "bench_row.h"

namespace interflect::cli {

/// What `bench --json` wrote, this version or an earlier one: fields that are not there keep their defaults, unknown
/// ones are left out. Throws an input Error, one line naming the file and the row, for a file that is no JSON, has no
/// header and rows, or has a row whose identity, seconds or status is missing, of another type, or makes no sense.
[[nodiscard]] BenchRun read_bench(const std::string& file);

}  // namespace interflect::cli
