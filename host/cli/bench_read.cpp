#include "bench_read.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/base/file.h"

namespace interflect::cli {

using nlohmann::ordered_json;

namespace {

constexpr std::uintmax_t largest_file = std::uintmax_t{64} << 20;
constexpr std::size_t most_rows = 100'000;

/// A row's object with the name of its place for errors.
class Fields {
 public:
  Fields(const ordered_json& object, std::string file, std::size_t row)
      : object_(object), file_(std::move(file)), row_(row) {
    if (!object.is_object()) fail("is no object");
  }

  [[noreturn]] void fail(const std::string& cause) const {
    throw input_error(file_, 0, fmt::format("row {} {}", row_, cause));
  }
  void take(const char* name, std::string& to, bool needed = false) const {
    const ordered_json* value = find(name, needed);
    if (value == nullptr) return;
    if (!value->is_string()) fail(fmt::format("has '{}' that is no text", name));
    to = value->get<std::string>();
  }
  /// A finite number that is not negative.
  void take(const char* name, double& to, bool needed = false) const {
    const ordered_json* value = find(name, needed);
    if (value != nullptr) to = positive(name, *value);
  }
  /// The same, or null.
  void take(const char* name, std::optional<double>& to) const {
    const ordered_json* value = find(name, false);
    if (value != nullptr && !value->is_null()) to = positive(name, *value);
  }
  /// A number, or null for one that is none (a broken kernel's error).
  void take_any(const char* name, double& to) const {
    const ordered_json* value = find(name, false);
    if (value == nullptr) return;
    to = value->is_null() ? std::numeric_limits<double>::quiet_NaN() : positive(name, *value);
  }
  template <class Count>
  void take_count(const char* name, Count& to, bool needed = false) const {
    const ordered_json* value = find(name, needed);
    if (value == nullptr) return;
    if (!value->is_number_unsigned() || value->get<std::uint64_t>() > std::numeric_limits<Count>::max()) {
      fail(fmt::format("has '{}' that is no count", name));
    }
    to = value->get<Count>();
  }

 private:
  [[nodiscard]] const ordered_json* find(const char* name, bool needed) const {
    const auto found = object_.find(name);
    if (found != object_.end()) return &*found;
    if (needed) fail(fmt::format("has no '{}'", name));
    return nullptr;
  }
  [[nodiscard]] double positive(const char* name, const ordered_json& value) const {
    const double number = value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
    if (!std::isfinite(number) || number < 0) fail(fmt::format("has '{}' that is no number of 0 or more", name));
    return number;
  }

  const ordered_json& object_;
  std::string file_;
  std::size_t row_;
};

BenchRow row_of(const Fields& fields) {
  BenchRow row;
  fields.take("device", row.device, true);
  fields.take("what", row.what, true);
  fields.take("scene", row.scene);
  fields.take("storage", row.storage);
  fields.take_count("n", row.n);
  fields.take_count("columns", row.columns);
  fields.take("seconds", row.seconds, true);
  row.seconds_min = row.seconds_max = row.seconds;
  fields.take("seconds_min", row.seconds_min);
  fields.take("seconds_max", row.seconds_max);
  if (row.seconds_min > row.seconds || row.seconds > row.seconds_max) fields.fail("has a median outside min and max");
  row.seconds_iqr = row.seconds_max - row.seconds_min;  // what files without it have instead
  fields.take("seconds_iqr", row.seconds_iqr);
  row.repetitions = row.seconds_max > row.seconds_min ? 2 : 1;
  fields.take_count("repetitions", row.repetitions);
  fields.take_count("bytes", row.bytes);
  fields.take_count("bytes_written", row.bytes_written);
  fields.take_count("flops", row.flops);
  fields.take("ceiling_gb_per_s", row.ceiling);
  fields.take("a_ratio", row.a_ratio);
  fields.take("machine_ratio", row.machine_ratio);
  fields.take_count("products", row.products);
  fields.take_count("launches", row.launches);
  fields.take("launch_share", row.launch_share);
  fields.take_any("error", row.error);
  fields.take_any("bound", row.bound);
  fields.take("status", row.status, true);
  if (row.status != "pass" && row.status != "fail" && row.status != "unsupported") {
    fields.fail("has a status that is not pass, fail or unsupported");
  }
  fields.take("reason", row.reason);
  fields.take("note", row.note);
  return row;
}

ordered_json parsed(const std::string& file) {
  try {
    return ordered_json::parse(read_file(file, largest_file));
  } catch (const ordered_json::exception& error) {
    // The first part of the library's message is its own number for it.
    std::string cause = error.what();
    if (const std::size_t end = cause.find("] "); end != std::string::npos) cause.erase(0, end + 2);
    throw input_error(file, 0, "is no JSON: " + cause);
  }
}

}  // namespace

BenchRun read_bench(const std::string& file) {
  const ordered_json root = parsed(file);
  if (!root.is_object() || !root.contains("header") || !root.at("header").is_object() || !root.contains("rows") ||
      !root.at("rows").is_array()) {
    throw input_error(file, 0, "is not what 'interflect bench --json' writes: no header and rows");
  }
  if (root.at("rows").size() > most_rows) throw input_error(file, 0, "has too many rows");
  BenchRun run;
  run.header = root.at("header");
  for (const ordered_json& row : root.at("rows")) {
    run.rows.push_back(row_of(Fields(row, file, run.rows.size() + 1)));
  }
  return run;
}

}  // namespace interflect::cli
