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
  std::uint32_t repetitions = 0;        ///< timed passes behind `seconds`
  double seconds_iqr = 0;               ///< upper less lower quartile of the passes
  std::uint64_t bytes_written = 0;      ///< of `bytes`
  std::uint64_t flops = 0;              ///< floating-point operations per repetition, a fused one as two
  std::uint64_t launches = 0;           ///< of kernels, in a solve
  std::optional<double> launch_share;   ///< launches times the measured time of one / seconds
  std::optional<double> ceiling;  ///< GB/s that the device's measured bandwidth allows this mix of reads and writes
  std::string note;               ///< what else there is to know, one line
  // Of an assembly.
  std::uint64_t rays = 0;              ///< shadow rays traced
  std::optional<double> trace_ratio;   ///< seconds / (seconds inside Embree for the same rays)
  std::optional<double> embree_ratio;  ///< (seconds of the Embree path, same passes) / seconds
  [[nodiscard]] double gb_per_s() const { return seconds > 0 ? static_cast<double>(bytes) / seconds * 1e-9 : 0; }
  /// GB/s over the ceiling.
  [[nodiscard]] std::optional<double> share_of_ceiling() const;
};

/// What one run of `bench` measured, or a file of it.
struct BenchRun {
  nlohmann::ordered_json header = nlohmann::ordered_json::object();
  std::vector<BenchRow> rows;
};

/// Sets status and reason.
void deny(BenchRow& row, std::string reason);

/// Sets the ceiling of each row that has moved bytes and has none yet: measured read bandwidth `read` where it only
/// reads; what it writes, and as much of what it reads, at the bandwidth of `copy`. Rates in GB/s, 0 for not known.
void set_ceiling(BenchRow& row, double read, double copy);

/// The row as its fields, in the order of the file; a number that is none is null.
[[nodiscard]] nlohmann::ordered_json to_json(const BenchRow& row);
/// The same fields in the same order: the header of to_json()'s names, and a line of its values, empty for null.
[[nodiscard]] std::string csv_header();
[[nodiscard]] std::string to_csv(const BenchRow& row);
[[nodiscard]] std::string text_header();
[[nodiscard]] std::string to_text(const BenchRow& row);

}  // namespace interflect::cli
