#include "interflect/device/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.h"
#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "interflect/schedule/check_assembly.h"
#include "report.h"
#include "validators.h"

namespace interflect::cli {

namespace {

constexpr std::uint64_t smallest_assembly = 1000;  // below it the tools that --max-size is for take minutes

struct Options {
  std::string device;
  std::uint64_t max_size = every_size;
  bool json = false;
};

std::vector<std::string> devices_to_check(const std::string& wanted) {
  if (!wanted.empty()) return {wanted};
  std::vector<std::string> ids;
  for (const DeviceEntry& entry : list_devices()) {
    if (entry.available) ids.push_back(entry.info.id);
  }
  return ids;
}

/// The device's rows. One that was not named and cannot be opened is a row of its own, so that the others are seen.
std::vector<KernelCheck> checked(const std::string& id, const Options& options) {
  try {
    const std::unique_ptr<Device> device = open_device(id);
    std::vector<KernelCheck> rows = check_device(*device, options.max_size);
    if (options.max_size >= smallest_assembly) check::check_assembly(*device, rows);
    return rows;
  } catch (const Error& error) {
    if (!options.device.empty()) throw;
    KernelCheck row;
    row.device = id;
    row.kernel = "open";
    row.reason = error.what();
    return {row};
  }
}

int run(const Options& options) {
  std::vector<KernelCheck> rows;
  for (const std::string& id : devices_to_check(options.device)) {
    const std::vector<KernelCheck> checks = checked(id, options);
    rows.insert(rows.end(), checks.begin(), checks.end());
  }
  const auto count = [&](CheckStatus status) {
    return std::count_if(rows.begin(), rows.end(), [status](const KernelCheck& row) { return row.status == status; });
  };
  if (options.json) {
    auto out = nlohmann::ordered_json::array();
    for (const KernelCheck& row : rows) {
      out.push_back({{"device", row.device},
                     {"kernel", row.kernel},
                     {"parameters", row.parameters},
                     {"size", row.size},
                     {"error", row.error},
                     {"bound", row.bound},
                     {"status", std::string(name(row.status))},
                     {"reason", row.reason}});
    }
    fmt::print("{}", dump(out));
  } else {
    for (const KernelCheck& row : rows) {
      fmt::print("{:<10} {:<12} {:<28} {:>7} {:>9.2e} of {:>8.2e}  {}{}{}\n", row.device, row.kernel, row.parameters,
                 row.size, row.error, row.bound, name(row.status), row.reason.empty() ? "" : ": ", row.reason);
    }
    fmt::print("{} passed, {} failed, {} not supported\n", count(CheckStatus::pass), count(CheckStatus::fail),
               count(CheckStatus::unsupported));
  }
  return count(CheckStatus::fail) == 0 ? 0 : exit_status(ErrorKind::device);
}

}  // namespace

void add_check(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("check", "run every kernel on every device against the fp64 reference");
  command.add_option("--device", options->device, "only this device");
  command.add_option("--max-size", options->max_size, "only cases of at most so many elements or lines")
      ->check(number(std::uint64_t{0}));
  command.add_flag("--json", options->json, "print JSON");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
