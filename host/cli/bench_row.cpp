#include "bench_row.h"

#include <fmt/format.h>

#include <utility>

namespace interflect::cli {

namespace {

/// A cell that may hold commas, quotes and line ends.
std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

}  // namespace

void deny(BenchRow& row, std::string reason) {
  row.status = "fail";
  row.reason = std::move(reason);
}

nlohmann::ordered_json to_json(const BenchRow& row) {
  return {{"device", row.device},
          {"what", row.what},
          {"scene", row.scene},
          {"storage", row.storage},
          {"n", row.n},
          {"columns", row.columns},
          {"seconds", row.seconds},
          {"seconds_min", row.seconds_min},
          {"seconds_max", row.seconds_max},
          {"bytes", row.bytes},
          {"gb_per_s", row.gb_per_s()},
          {"a_ratio", row.a_ratio},
          {"machine_ratio",
           row.machine_ratio ? nlohmann::ordered_json(*row.machine_ratio) : nlohmann::ordered_json(nullptr)},
          {"products", row.products},
          {"error", row.error},
          {"bound", row.bound},
          {"status", row.status},
          {"reason", row.reason}};
}

std::string csv_header() {
  return "device,what,scene,storage,n,columns,seconds,seconds_min,seconds_max,bytes,gb_per_s,a_ratio,machine_ratio,"
         "products,error,bound,status,reason\n";
}

std::string to_csv(const BenchRow& row) {
  return fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", row.device, row.what, quoted(row.scene),
                     row.storage, row.n, row.columns, row.seconds, row.seconds_min, row.seconds_max, row.bytes,
                     row.gb_per_s(), row.a_ratio, row.machine_ratio ? fmt::format("{}", *row.machine_ratio) : "",
                     row.products, row.error, row.bound, row.status, quoted(row.reason));
}

std::string text_header() {
  return fmt::format("{:<10} {:<19} {:<11} {:>7} {:>11} {:>23} {:>8} {:>5} {:>5} {:>4}  {:<18} {}\n", "device", "what",
                     "scene", "n", "seconds", "min .. max", "GB/s", "of A", "of M", "prod", "error of bound", "status");
}

std::string to_text(const BenchRow& row) {
  const auto ratio = [](double value) { return value > 0 ? fmt::format("{:.2f}", value) : ""; };
  const std::string error = row.error > 0 || row.bound > 0 ? fmt::format("{:.1e} of {:.1e}", row.error, row.bound) : "";
  const std::string products = row.products > 0 ? fmt::format("{}", row.products) : "";
  const std::string rate = row.bytes > 0 ? fmt::format("{:.2f}", row.gb_per_s()) : "";
  const std::string times =
      row.seconds > 0 ? fmt::format("{:>11.7f} {:>10.7f} ..{:>10.7f}", row.seconds, row.seconds_min, row.seconds_max)
                      : std::string(35, ' ');
  return fmt::format("{:<10} {:<19} {:<11} {:>7} {:<35} {:>8} {:>5} {:>5} {:>4}  {:<18} {}{}{}\n", row.device, row.what,
                     row.scene, row.n > 0 ? fmt::format("{}", row.n) : "", times, rate, ratio(row.a_ratio),
                     ratio(row.machine_ratio.value_or(0)), products, error, row.status, row.reason.empty() ? "" : ": ",
                     row.reason);
}

}  // namespace interflect::cli
