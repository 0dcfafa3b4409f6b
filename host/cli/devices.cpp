#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.h"
#include "interflect/base/error.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/registry.h"
#include "launch.h"
#include "report.h"
#include "selftest.h"

namespace interflect::cli {

namespace {

std::string_view type_name(DeviceType type) {
  switch (type) {
    case DeviceType::cpu: return "cpu";
    case DeviceType::gpu: return "gpu";
    case DeviceType::other: break;
  }
  return "other";
}

struct Options {
  bool json = false;
  bool selftest = false;
};

struct Row {
  DeviceEntry entry;
  Rate read;             ///< of 0 bytes when it could not be measured
  std::string selftest;  ///< "PASS", "FAIL: why", or empty when not asked for
  [[nodiscard]] bool measured() const { return read.verified; }
};

Row row_of(const DeviceEntry& entry, const Options& options) {
  Row row{entry, {}, ""};
  row.read.reason = "the device is not available";
  if (!entry.available) return row;
  try {
    row.read = quick_read_bandwidth(*open_device(entry.info.id));
  } catch (const Error& error) {
    row.read.reason = first_line(error.what());
  }
  if (options.selftest) row.selftest = selftest(entry.info.id);
  return row;
}

bool same_hardware(const Row& a, const Row& b) {
  return !a.entry.info.hardware.empty() && a.entry.info.hardware == b.entry.info.hardware;
}

nlohmann::ordered_json to_json(const Row& row, const std::vector<Row>& all) {
  const DeviceInfo& info = row.entry.info;
  nlohmann::ordered_json out;
  out["id"] = info.id;
  out["backend"] = info.backend;
  out["name"] = info.name;
  out["driver"] = info.driver;
  out["type"] = std::string(type_name(info.type));
  out["emulated"] = info.emulated();
  out["memory_bytes"] = info.memory_bytes;
  out["compute_units"] = info.compute_units;
  out["hardware"] = info.hardware;
  out["same_device_as"] = nlohmann::ordered_json::array();
  for (const Row& other : all) {
    if (other.entry.info.id != info.id && same_hardware(row, other)) {
      out["same_device_as"].push_back(other.entry.info.id);
    }
  }
  out["available"] = row.entry.available;
  out["reason"] = row.entry.reason;
  out["read_gb_per_s"] = row.measured() ? nlohmann::ordered_json(row.read.gb_per_s()) : nlohmann::ordered_json(nullptr);
  out["read_reason"] = row.measured() ? "" : row.read.reason;
  out["selftest"] = row.selftest.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(row.selftest);
  return out;
}

/// One driver's view of a device: "  cuda:0     gpu              132 units   79.1 GiB   2841.0 GB/s  PASS  CUDA 12.4".
std::string line_of(const Row& row) {
  const DeviceInfo& info = row.entry.info;
  if (!row.entry.available) return fmt::format("  {:<10} not available: {}\n", info.id, row.entry.reason);
  const std::string type = fmt::format("{}{}", type_name(info.type), info.emulated() ? ", emulated" : "");
  const std::string units = info.compute_units > 0 ? fmt::format("{} units", info.compute_units) : "";
  const std::string memory =
      info.memory_bytes > 0 ? fmt::format("{:.1f} GiB", static_cast<double>(info.memory_bytes) / (1 << 30)) : "";
  const std::string read = row.measured() ? fmt::format("{:.1f} GB/s", row.read.gb_per_s()) : "not measured";
  std::string out = fmt::format("  {:<10} {:<13} {:>9} {:>11} {:>13}  {}{}{}\n", info.id, type, units, memory, read,
                                row.selftest.substr(0, 4), row.selftest.empty() ? "" : "  ", info.driver);
  const auto beneath = [&](std::string_view what, std::string_view why) {
    out += fmt::format("  {:<10} {}{}\n", "", what, why);
  };
  if (!row.measured()) beneath("not measured: ", row.read.reason);
  if (row.selftest.starts_with("FAIL")) beneath("selftest ", row.selftest);
  return out;
}

/// A block for each piece of hardware: its name, and a line for each id that it has.
std::string to_text(const std::vector<Row>& rows) {
  std::string out;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const auto same = [&](const Row& other) { return same_hardware(rows[k], other); };
    const auto begin = rows.begin(), here = begin + static_cast<std::ptrdiff_t>(k);
    if (std::any_of(begin, here, same)) continue;  // in an earlier block
    const DeviceInfo& info = here->entry.info;
    out += fmt::format("{}\n{}", info.name.empty() ? info.backend : info.name, line_of(*here));
    for (auto other = here + 1; other != rows.end(); ++other) out += same(*other) ? line_of(*other) : "";
  }
  return out;
}

int run(const Options& options) {
  std::vector<Row> rows;
  for (const DeviceEntry& entry : list_devices()) rows.push_back(row_of(entry, options));
  if (options.json) {
    auto out = nlohmann::ordered_json::array();
    for (const Row& row : rows) out.push_back(to_json(row, rows));
    fmt::print("{}", dump(out));
  } else {
    fmt::print("{}ranks (MPI)  {}\n", to_text(rows), mpi_state());
  }
  const bool failed =
      std::any_of(rows.begin(), rows.end(), [](const Row& row) { return row.selftest.starts_with("FAIL"); });
  return failed ? exit_status(ErrorKind::device) : 0;
}

}  // namespace

void add_devices(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("devices", "list the devices that can compute");
  command.add_flag("--json", options->json, "print JSON");
  command.add_flag("--selftest", options->selftest, "solve a small room on each and say PASS or FAIL");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
