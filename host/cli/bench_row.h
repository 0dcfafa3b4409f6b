#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace interflect::cli {

/// One line of `bench`: a measured and verified time, or the reason why there is none.
struct BenchRow {
  std::string device, what, scene, storage;
  std::uint32_t n = 0, columns = 0;
  double seconds = 0, seconds_min = 0, seconds_max = 0;  ///< median and spread
  std::uint64_t bytes = 0;                               ///< moved per repetition
  double a_ratio = 0;  ///< (time to read the dense fp32 matrix on that device, same pass) / seconds, for a matvec
  /// (time in which OpenMP reads that matrix, same pass) / seconds, on devices of type cpu.
  std::optional<double> machine_ratio;
  std::uint32_t products = 0;
  double error = 0, bound = 0;
  std::string status = "pass", reason;  ///< pass, fail, unsupported (a limit of the device)
  [[nodiscard]] double gb_per_s() const { return seconds > 0 ? static_cast<double>(bytes) / seconds * 1e-9 : 0; }
};

/// Sets status and reason.
void deny(BenchRow& row, std::string reason);

[[nodiscard]] nlohmann::ordered_json to_json(const BenchRow& row);
[[nodiscard]] std::string csv_header();
[[nodiscard]] std::string to_csv(const BenchRow& row);
[[nodiscard]] std::string text_header();
[[nodiscard]] std::string to_text(const BenchRow& row);

}  // namespace interflect::cli
