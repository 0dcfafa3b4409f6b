#include "tune.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/registry.h"
#include "interflect/device/tuning.h"
#include "report.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  std::optional<std::string> device;
  double seconds = 10;
  bool list = false, clear = false, json = false, quiet = false;
};

std::string text(const Macros& macros) {
  std::string out;
  for (const auto& [name, value] : macros) out += fmt::format("{}{}={}", out.empty() ? "" : " ", name, value);
  return out;
}

std::string gain_text(const TunedShape& shape) {
  return shape.chosen == shape.standard ? "-" : fmt::format("{:.2f} x", shape.gain);
}

/// The chosen devices, available or not. Every device without --device.
std::vector<DeviceInfo> wanted_devices(const Options& options) {
  std::vector<DeviceInfo> infos;
  std::vector<std::string> ids;
  if (options.device) ids = choose_devices(*options.device);
  for (const DeviceEntry& entry : list_devices()) {
    const bool named = std::find(ids.begin(), ids.end(), entry.info.id) != ids.end();
    if (options.device ? named : entry.available) infos.push_back(entry.info);
  }
  return infos;
}

// --list, --clear

int list(const Options& options) {
  std::vector<KeptShape> all = kept_shapes();
  if (options.device) {
    const std::vector<DeviceInfo> devices = wanted_devices(options);
    std::erase_if(all, [&](const KeptShape& kept) {
      return std::none_of(devices.begin(), devices.end(), [&](const DeviceInfo& device) { return kept.of(device); });
    });
  }
  if (options.json) {
    auto out = nlohmann::ordered_json::array();
    for (const KeptShape& kept : all) {
      out.push_back({{"backend", kept.backend},
                     {"name", kept.name},
                     {"driver", kept.driver},
                     {"kernel", kept.shape.kernel},
                     {"default", kept.shape.standard},
                     {"chosen", kept.shape.chosen},
                     {"gain", kept.shape.gain},
                     {"complete", kept.shape.done},
                     {"file", kept.file.string()}});
    }
    fmt::print("{}", dump(out));
    return 0;
  }
  std::string device;
  for (const KeptShape& kept : all) {
    const std::string of = fmt::format("{} {} ({})\n", kept.backend, kept.name, kept.driver);
    if (of != device) fmt::print("{}", of);
    device = of;
    fmt::print("  {:<8} {:<28} {:>7}{}\n", kept.shape.kernel, text(kept.shape.chosen), gain_text(kept.shape),
               kept.shape.done ? "" : "  (time was up)");
  }
  return 0;
}

int clear(const Options& options) {
  std::size_t count = 0;
  if (!options.device) {
    count = forget_shapes();
  } else {
    const std::vector<DeviceInfo> devices = wanted_devices(options);
    count = forget_shapes(&devices);
  }
  fmt::print("{} {} removed\n", count, count == 1 ? "entry" : "entries");
  return 0;
}

// The search

void print_row(const std::string& id, const TunedShape& shape) {
  const std::string check = shape.chosen != shape.standard ? "pass"
                            : shape.done                   ? "default kept"
                                                           : "default kept, time was up";
  fmt::print("{:<10} {:<8} {:<28} {:<28} {:>7}  {}\n", id, shape.kernel, text(shape.standard), text(shape.chosen),
             gain_text(shape), check);
  for (const std::string& refused : shape.refused) fmt::print("{:<10} {:<8} refused: {}\n", "", "", refused);
}

/// False when one of its kernels failed.
bool tune_device(Device& device, double seconds, Console& console) {
  const DeviceInfo& info = device.info();
  const Timer timer;
  const std::vector<std::string> kernels = tunable_kernels(info);
  if (kernels.empty()) fmt::print("{:<10} nothing to tune\n", info.id);
  bool good = true;
  for (std::size_t k = 0; k < kernels.size(); ++k) {
    TuningOptions options;
    // What is left, in equal shares.
    options.seconds = (seconds - timer.seconds()) / static_cast<double>(kernels.size() - k);
    try {
      const TunedShape shape = search_shape(device, kernels[k], options);
      print_row(info.id, shape);
      if (const std::string why = keep_shape(info, shape); !why.empty()) {
        console.message(fmt::format("warning: {} {} is not kept: {}", info.id, kernels[k], why));
      }
    } catch (const Error& error) {
      const bool limit = error.kind() == ErrorKind::limit;
      fmt::print("{:<10} {:<8} {}: {}\n", info.id, kernels[k], limit ? "unsupported" : "fail",
                 first_line(error.what()));
      good = good && limit;
    }
    std::fflush(stdout);
  }
  return good;
}

int search(const Options& options) {
  if (!tuning_allowed()) throw Error(ErrorKind::usage, "INTERFLECT_TUNING is off: nothing is tuned");
  Console console(options.quiet);
  std::vector<std::string> ids;
  if (options.device) {
    ids = choose_devices(*options.device);
    if (*options.device == "auto") ids.resize(1);
  } else {
    for (const DeviceInfo& info : wanted_devices(options)) ids.push_back(info.id);
  }
  fmt::print("{:<10} {:<8} {:<28} {:<28} {:>7}  {}\n", "device", "kernel", "default", "chosen", "gain", "check");
  bool good = true;
  for (const std::string& id : ids) {
    try {
      good = tune_device(*open_device(id), options.seconds, console) && good;
    } catch (const Error& error) {
      if (ids.size() == 1) throw;
      fmt::print("{:<10} fail: {}\n", id, first_line(error.what()));
      good = false;
    }
  }
  return good ? 0 : exit_status(ErrorKind::device);
}

int run(const Options& options) {
  if (options.list) return list(options);
  return options.clear ? clear(options) : search(options);
}

std::string_view kernel_of(Storage storage) {
  switch (storage) {
    case Storage::dense32: return "matvec";
    case Storage::sym16: return "sym16";
    default: return "tiles16";
  }
}

}  // namespace

void tune_on_first_use(Device& device, Storage storage, std::uint32_t n, ProgressSink& progress) {
  constexpr std::uint64_t worth_it = std::uint64_t{64} << 20;
  const DeviceInfo& info = device.info();
  const std::string_view kernel = kernel_of(storage);
  if (!tuning_allowed() || std::uint64_t{n} * n * sizeof(float) < worth_it) return;
  try {
    if (tunable_macros(info, kernel).empty() || kept_shape(info, kernel) || !shapes_can_be_kept()) return;
    const Timer timer;
    const TunedShape shape = search_shape(device, kernel);
    if (!keep_shape(info, shape).empty()) return;
    progress.message(
        fmt::format("tuned {} on {} in {:.1f} s: {} (see 'interflect tune --help')", kernel, info.id, timer.seconds(),
                    shape.chosen == shape.standard ? std::string("the default is kept")
                                                   : fmt::format("{}, {}", text(shape.chosen), gain_text(shape))));
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::device && error.kind() != ErrorKind::limit) throw;
  }
}

void tune_on_first_use(const std::vector<std::string>& devices, std::span<const Storage> formats, std::uint32_t n,
                       ProgressSink& progress) {
  for (const std::string& id : devices) {
    try {
      const auto device = open_device(id);
      for (const Storage storage : formats) tune_on_first_use(*device, storage, n, progress);
    } catch (const Error&) {  // its rows will say so
    }
  }
}

void add_tune(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command =
      *program.add_subcommand("tune", "search the launch shapes of the product kernels on each device, and keep them");
  command.add_option("--device", options->device, "device id, or several between commas (default: all)");
  auto* seconds = command.add_option("--seconds", options->seconds, "time for each device")
                      ->check(number(0.0, 3600.0))
                      ->capture_default_str();
  auto* listing = command.add_flag("--list", options->list, "print what is kept");
  command.add_flag("--json", options->json, "with --list: print JSON")->needs(listing);
  command.add_flag("--clear", options->clear, "remove what is kept")->excludes(listing)->excludes(seconds);
  listing->excludes(seconds);
  command.add_flag("--quiet", options->quiet, "no warnings");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
