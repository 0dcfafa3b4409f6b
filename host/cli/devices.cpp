#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.h"
#include "interflect/base/error.h"
#include "interflect/device/registry.h"
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
  std::string selftest;  ///< "PASS", "FAIL: why", or empty when not asked for
};

nlohmann::ordered_json to_json(const Row& row) {
  const DeviceInfo& info = row.entry.info;
  nlohmann::ordered_json out;
  out["id"] = info.id;
  out["backend"] = info.backend;
  out["name"] = info.name;
  out["driver"] = info.driver;
  out["type"] = std::string(type_name(info.type));
  out["memory_bytes"] = info.memory_bytes;
  out["compute_units"] = info.compute_units;
  out["available"] = row.entry.available;
  out["reason"] = row.entry.reason;
  out["selftest"] = row.selftest.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(row.selftest);
  return out;
}

int run(const Options& options) {
  std::vector<Row> rows;
  for (const DeviceEntry& entry : list_devices()) {
    rows.push_back({entry, options.selftest && entry.available ? selftest(entry.info.id) : ""});
  }
  if (options.json) {
    auto out = nlohmann::ordered_json::array();
    for (const Row& row : rows) out.push_back(to_json(row));
    fmt::print("{}", dump(out));
  } else {
    for (const Row& row : rows) {
      const DeviceInfo& info = row.entry.info;
      fmt::print("{:<10} {} ({}, {}, {} compute units, {:.1f} GiB)\n", info.id, info.name, type_name(info.type),
                 info.driver, info.compute_units, static_cast<double>(info.memory_bytes) / (1 << 30));
      if (!row.entry.available) fmt::print("{:<10} not available: {}\n", "", row.entry.reason);
      if (!row.selftest.empty()) fmt::print("{:<10} selftest: {}\n", "", row.selftest);
    }
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
