#pragma once

#include <string>

#include "bench_row.h"

namespace interflect::cli {

/// Whether the name ends in what `bench --plot` can write: .html or .svg. Throws a usage Error when not.
void check_plot_name(const std::string& file);

/// The run as one self-contained page (.html) or drawing (.svg), well-formed XML, without scripts, fonts or anything
/// else from elsewhere; colours follow the reader's light or dark preference. A roofline per device, the shares of the
/// ceilings, solve times, the other times, growth curves where there are "growth" rows, and every row in a table.
[[nodiscard]] std::string plot(const BenchRun& run, const std::string& file);

}  // namespace interflect::cli
