#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "interflect/base/progress.h"
#include "study.h"

namespace interflect::cli {

/// One line of `bench`: a measured and verified time, or the reason why there is none.
struct BenchRow {
  std::string device, what, scene, storage;
  std::uint32_t n = 0, columns = 0;
  double seconds = 0, seconds_min = 0, seconds_max = 0;  ///< median and spread
  std::uint64_t bytes = 0;                               ///< moved per repetition
  double a_ratio = 0;  ///< (time to read the dense fp32 matrix on that device, same run) / seconds, for a matvec
  std::uint32_t products = 0;
  double error = 0, bound = 0;
  std::string status = "pass", reason;
  [[nodiscard]] double gb_per_s() const { return seconds > 0 ? static_cast<double>(bytes) / seconds * 1e-9 : 0; }
};

/// Rows for one room on one device: the read bandwidth over its matrix and the matvec, in turn, then a solve per
/// method.
[[nodiscard]] std::vector<BenchRow> bench_room(const std::string& folder, const Room& room, const std::string& device,
                                               unsigned repetitions, ProgressSink& progress);

[[nodiscard]] nlohmann::ordered_json to_json(const BenchRow& row);
[[nodiscard]] std::string csv_header();
[[nodiscard]] std::string to_csv(const BenchRow& row);
[[nodiscard]] std::string text_header();
[[nodiscard]] std::string to_text(const BenchRow& row);

}  // namespace interflect::cli
