#include "bench_header.h"

#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <cmath>

#include "bench_machine.h"
#include "interflect/base/memory.h"
#include "interflect_commit.h"
#include "study.h"

namespace interflect::cli {

using nlohmann::ordered_json;

namespace {

ordered_json number(const std::optional<double>& value) {
  return value ? ordered_json(*value) : ordered_json(nullptr);
}

ordered_json device_json(const DeviceInfo& info) {
  Clock clock;
  if (info.type == DeviceType::cpu) clock = processor_clock();
  if (info.max_clock_mhz > 0 && !clock.most && info.type != DeviceType::cpu) clock.most = info.max_clock_mhz;
  return {{"id", info.id},
          {"name", info.name},
          {"driver", info.driver},
          {"compute_units", info.compute_units},
          {"clock_mhz", number(clock.now)},
          {"max_clock_mhz", number(clock.most)},
          {"memory_bytes", info.memory_bytes > 0 ? ordered_json(info.memory_bytes) : ordered_json(nullptr)}};
}

std::string compiler() {
#if defined(__clang__)
  return fmt::format("Clang {}.{}.{}", __clang_major__, __clang_minor__, __clang_patchlevel__);
#else
  return fmt::format("GCC {}.{}.{}", __GNUC__, __GNUC_MINOR__, __GNUC_PATCHLEVEL__);
#endif
}

/// A value of the header as text, whatever type a file gives it.
std::string text_of(const ordered_json& value) {
  if (value.is_null()) return "unknown";
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

std::string field(const ordered_json& object, const char* name) {
  return object.is_object() && object.contains(name) ? text_of(object.at(name)) : "unknown";
}

std::string megahertz(const ordered_json& device, const char* name) {
  const auto value = device.find(name);
  return value != device.end() && value->is_number() ? fmt::format("{:.0f} MHz", value->get<double>()) : "unknown";
}

std::string device_text(const ordered_json& device) {
  const auto memory = device.find("memory_bytes");
  const std::string size = memory != device.end() && memory->is_number()
                               ? fmt::format("{:.1f} GiB", memory->get<double>() / (1U << 30))
                               : "unknown";
  return fmt::format("{} ({}), {}, {} compute units, clock {} (at most {}), memory {}\n", field(device, "id"),
                     field(device, "name"), field(device, "driver"), field(device, "compute_units"),
                     megahertz(device, "clock_mhz"), megahertz(device, "max_clock_mhz"), size);
}

}  // namespace

ordered_json bench_header(const std::vector<DeviceInfo>& infos, unsigned repetitions) {
  auto devices = ordered_json::array();
  for (const DeviceInfo& info : infos) devices.push_back(device_json(info));
  ordered_json environment = ordered_json::object();
  for (const auto& [name, value] : settings()) environment[name] = value;
  return {{"interflect", INTERFLECT_VERSION},
          {"commit", INTERFLECT_COMMIT},
          {"date", utc_now()},
          {"compiler", compiler()},
          {"devices", devices},
          {"load_average", load_average()},
          {"omp_threads", ::omp_get_max_threads()},
          {"available_memory_bytes", available_memory()},
          {"settings", environment},
          {"repetitions", repetitions},
          {"statistic",
           "median, minimum, maximum and interquartile range; devices take turns pass by pass, ratios are the median "
           "of those of a pass"}};
}

std::string header_text(const ordered_json& header) {
  std::string out = fmt::format("interflect {}", field(header, "interflect"));
  if (header.contains("commit") && !field(header, "commit").empty())
    out += fmt::format(" ({})", field(header, "commit"));
  if (header.contains("compiler")) out += ", " + field(header, "compiler");
  if (header.contains("date")) out += ", " + field(header, "date");
  out += '\n';
  if (header.contains("devices") && header.at("devices").is_array()) {
    for (const ordered_json& device : header.at("devices")) {
      if (device.is_object()) out += device_text(device);
    }
  }
  if (header.contains("load_average")) {
    std::string loads;
    for (const ordered_json& load : header.at("load_average")) {
      if (load.is_number()) loads += fmt::format(" {:.2f}", load.get<double>());
    }
    out += fmt::format("load average{}, {} OpenMP threads", loads.empty() ? " unknown" : loads,
                       field(header, "omp_threads"));
    if (header.contains("settings") && header.at("settings").is_object()) {
      for (const auto& [name, value] : header.at("settings").items()) out += ", " + name + "=" + text_of(value);
    }
    out += '\n';
  }
  return out + fmt::format("{} repetitions\n", field(header, "repetitions"));
}

void set_spread(ordered_json& header, const std::vector<BenchRow>& rows) {
  std::vector<double> shares;
  const BenchRow* widest = nullptr;
  const auto share = [](const BenchRow& row) { return row.seconds_iqr / row.seconds; };
  for (const BenchRow& row : rows) {
    if (row.repetitions < 2 || !(row.seconds > 0)) continue;
    shares.push_back(share(row));
    if (widest == nullptr || share(row) > share(*widest)) widest = &row;
  }
  header["spread"] = nullptr;
  if (widest == nullptr) return;
  header["spread"] = {
      {"statistic", "interquartile range over the median"},
      {"median", median(shares)},
      {"largest", share(*widest)},
      {"of", fmt::format("{} {}{}{}", widest->device, widest->what, widest->scene.empty() ? "" : " ", widest->scene)}};
}

std::string spread_text(const ordered_json& header) {
  if (!header.contains("spread") || !header.at("spread").is_object()) return "";
  const ordered_json& spread = header.at("spread");
  const auto percent = [&](const char* name) {
    const auto value = spread.find(name);
    return value != spread.end() && value->is_number() ? fmt::format("{:.1f} %", 100 * value->get<double>()) : "?";
  };
  return fmt::format(
      "spread of the repetitions (interquartile range over the median): {} in the median of the rows, {} "
      "at most ({})\n",
      percent("median"), percent("largest"), field(spread, "of"));
}

}  // namespace interflect::cli
