#pragma once

#include <string>
#include <vector>

#include "bench_row.h"
#include "interflect/device/device.h"

namespace interflect::cli {

/// What was measured with what: date, version, commit, compiler, machine and its load, settings of the environment, and
/// per device id, name, driver, units, clock and memory. What is not known is null, "unknown" in the text.
[[nodiscard]] nlohmann::ordered_json bench_header(const std::vector<DeviceInfo>& devices, unsigned repetitions);

/// The header for people; fields that it has not (a file of an earlier version) are left out.
[[nodiscard]] std::string header_text(const nlohmann::ordered_json& header);

/// Puts the spread of the rows' passes into the header, as shares of their medians: of the interquartile range the
/// median over all rows and the largest with its row. Rows of one pass have none.
void set_spread(nlohmann::ordered_json& header, const std::vector<BenchRow>& rows);
/// A line of it, empty when there is none.
[[nodiscard]] std::string spread_text(const nlohmann::ordered_json& header);

}  // namespace interflect::cli
