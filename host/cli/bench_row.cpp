#include "bench_row.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace interflect::cli {

using nlohmann::ordered_json;

namespace {

/// A cell that may hold commas, quotes and line ends.
std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

ordered_json number(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json number(const std::optional<double>& value) {
  return value ? number(*value) : ordered_json(nullptr);
}

std::string cell(const ordered_json& value) {
  if (value.is_null()) return "";
  return value.is_string() ? quoted(value.get<std::string>()) : value.dump();
}

}  // namespace

std::optional<double> BenchRow::share_of_ceiling() const {
  if (!ceiling || !(*ceiling > 0) || !(gb_per_s() > 0)) return std::nullopt;
  return gb_per_s() / *ceiling;
}

void deny(BenchRow& row, std::string reason) {
  row.status = "fail";
  row.reason = std::move(reason);
}

void set_ceiling(BenchRow& row, double read, double copy) {
  if (row.ceiling || row.bytes == 0 || row.bytes_written > row.bytes) return;
  const std::uint64_t copied = 2 * std::min(row.bytes_written, row.bytes - row.bytes_written);
  if (!(read > 0) || (copied > 0 && !(copy > 0))) return;
  // The time of both parts at their own rate, in which the whole is moved.
  const double time =
      static_cast<double>(row.bytes - copied) / read + (copied > 0 ? static_cast<double>(copied) / copy : 0.0);
  row.ceiling = static_cast<double>(row.bytes) / time;
}

ordered_json to_json(const BenchRow& row) {
  // New fields go to the end: programs read the CSV by the place of its columns.
  return {{"device", row.device},
          {"what", row.what},
          {"scene", row.scene},
          {"storage", row.storage},
          {"n", row.n},
          {"columns", row.columns},
          {"seconds", number(row.seconds)},
          {"seconds_min", number(row.seconds_min)},
          {"seconds_max", number(row.seconds_max)},
          {"bytes", row.bytes},
          {"gb_per_s", number(row.gb_per_s())},
          {"a_ratio", number(row.a_ratio)},
          {"machine_ratio", number(row.machine_ratio)},
          {"products", row.products},
          {"error", number(row.error)},
          {"bound", number(row.bound)},
          {"status", row.status},
          {"reason", row.reason},
          {"repetitions", row.repetitions},
          {"seconds_iqr", number(row.seconds_iqr)},
          {"bytes_written", row.bytes_written},
          {"flops", row.flops},
          {"ceiling_gb_per_s", number(row.ceiling)},
          {"share_of_ceiling", number(row.share_of_ceiling())},
          {"launches", row.launches},
          {"launch_share", number(row.launch_share)},
          {"note", row.note},
          {"rays", row.rays},
          {"trace_ratio", number(row.trace_ratio)},
          {"embree_ratio", number(row.embree_ratio)}};
}

std::string csv_header() {
  const ordered_json fields = to_json(BenchRow{});
  std::vector<std::string> names;
  for (const auto& [name, value] : fields.items()) names.push_back(name);
  return fmt::format("{}\n", fmt::join(names, ","));
}

std::string to_csv(const BenchRow& row) {
  const ordered_json fields = to_json(row);
  std::vector<std::string> cells;
  for (const auto& [name, value] : fields.items()) cells.push_back(cell(value));
  return fmt::format("{}\n", fmt::join(cells, ","));
}

std::string text_header() {
  return fmt::format("{:<10} {:<19} {:<11} {:<8} {:>7} {:>11} {:>23} {:>8} {:>6} {:>5} {:>5} {:>4} {:>6}  {:<18} {}\n",
                     "device", "what", "scene", "storage", "n", "seconds", "min .. max", "GB/s", "share", "of A",
                     "of M", "prod", "launch", "error of bound", "status");
}

std::string to_text(const BenchRow& row) {
  const auto ratio = [](double value) { return value > 0 ? fmt::format("{:.2f}", value) : ""; };
  const std::string error = row.error > 0 || row.bound > 0 ? fmt::format("{:.1e} of {:.1e}", row.error, row.bound) : "";
  const std::string products = row.products > 0 ? fmt::format("{}", row.products) : "";
  const std::string rate = row.bytes > 0 && row.seconds > 0 ? fmt::format("{:.2f}", row.gb_per_s()) : "";
  const std::string launches = row.launch_share ? fmt::format("{:.1f} %", 100 * *row.launch_share) : "";
  const std::string times =
      row.seconds > 0 ? fmt::format("{:>11.7f} {:>10.7f} ..{:>10.7f}", row.seconds, row.seconds_min, row.seconds_max)
                      : std::string(35, ' ');
  const std::string why = row.reason.empty() ? row.note : row.reason;
  return fmt::format("{:<10} {:<19} {:<11} {:<8} {:>7} {:<35} {:>8} {:>6} {:>5} {:>5} {:>4} {:>6}  {:<18} {}{}{}\n",
                     row.device, row.what, row.scene, row.storage, row.n > 0 ? fmt::format("{}", row.n) : "", times,
                     rate, ratio(row.share_of_ceiling().value_or(0)), ratio(row.a_ratio),
                     ratio(row.machine_ratio.value_or(0)), products, launches, error, row.status,
                     why.empty() ? "" : ": ", why);
}

}  // namespace interflect::cli
