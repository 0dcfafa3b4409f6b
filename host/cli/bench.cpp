#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "bench_rows.h"
#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/device/registry.h"
#include "report.h"
#include "study.h"
#include "tune.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  bool study = false, peers = false;
  std::string device = "auto";
  std::string scenes;
  std::vector<unsigned> rooms;
  std::string json, csv;
  unsigned repetitions = 15;
  bool quiet = false;
};

/// A device that cannot be opened is an error when it is the only one; else its rows say so.
DeviceInfo info_of(const std::string& id, bool alone) {
  try {
    return open_device(id)->info();
  } catch (const Error& error) {
    if (alone) throw;
    DeviceInfo info;
    info.id = id;
    info.name = first_line(error.what());
    return info;
  }
}

nlohmann::ordered_json header(const std::vector<DeviceInfo>& infos, unsigned repetitions) {
  nlohmann::ordered_json devices = nlohmann::ordered_json::array();
  for (const DeviceInfo& info : infos) {
    devices.push_back(
        {{"id", info.id}, {"name", info.name}, {"driver", info.driver}, {"compute_units", info.compute_units}});
  }
  return {{"interflect", INTERFLECT_VERSION},
          {"devices", devices},
          {"repetitions", repetitions},
          {"statistic",
           "median, minimum and maximum; devices take turns pass by pass, ratios are the median of those of a pass"}};
}

void write_json(const std::string& path, const nlohmann::ordered_json& value) {
  AtomicFile file(path);
  file.write(dump(value));
  file.commit();
}

void write_files(const Options& options, const nlohmann::ordered_json& head, const std::vector<BenchRow>& rows) {
  if (!options.json.empty()) {
    nlohmann::ordered_json out;
    out["header"] = head;
    out["rows"] = nlohmann::ordered_json::array();
    for (const BenchRow& row : rows) out["rows"].push_back(to_json(row));
    write_json(options.json, out);
  }
  if (!options.csv.empty()) {
    AtomicFile file(options.csv);
    file.write(csv_header());
    for (const BenchRow& row : rows) file.write(to_csv(row));
    file.commit();
  }
}

int run(const Options& options) {
  Console console(options.quiet);
  for (const std::string& file : {options.json, options.csv}) {
    if (!file.empty()) const AtomicFile probe(file);  // found before the work: it cannot be written
  }
  std::vector<std::string> ids = choose_devices(options.device);
  if (options.device == "auto") ids.resize(1);
  std::vector<DeviceInfo> infos;
  infos.reserve(ids.size());
  for (const std::string& id : ids) infos.push_back(info_of(id, ids.size() == 1));
  const std::string folder = scenes_folder(options.scenes);
  if (options.study) {
    const unsigned passes = std::max(1U, options.repetitions / 3);
    const StudyTables tables = study_tables(folder, ids.front(), passes, options.rooms, console);
    fmt::print("{}", tables.text);
    if (!options.json.empty()) {
      nlohmann::ordered_json out = {{"header", header(infos, passes)}};
      out.update(tables.data);
      write_json(options.json, out);
    }
    return tables.verified ? 0 : exit_status(ErrorKind::device);
  }
  const auto head = header(infos, options.repetitions);
  for (const DeviceInfo& info : infos) {
    fmt::print("{} ({}), {}, {} compute units\n", info.id, info.name, info.driver, info.compute_units);
  }
  fmt::print("{} repetitions\n{}", options.repetitions, text_header());
  std::vector<BenchRow> rows;
  const auto add = [&](const std::vector<BenchRow>& more) {
    for (const BenchRow& row : more) fmt::print("{}", to_text(row));
    std::fflush(stdout);
    rows.insert(rows.end(), more.begin(), more.end());
  };
  add(bench_devices(ids, options.repetitions));
  for (const Room& room : study_rooms()) {
    const bool wanted = options.rooms.empty() ||
                        std::find(options.rooms.begin(), options.rooms.end(), room.patches) != options.rooms.end();
    if (!wanted) continue;
    constexpr Storage formats[] = {Storage::dense32};
    tune_on_first_use(ids, formats, room.patches, console);
    add(bench_room(folder, room, ids, options.repetitions, options.peers, console));
  }
  write_files(options, head, rows);
  const bool failed = std::any_of(rows.begin(), rows.end(), [](const BenchRow& row) { return row.status == "fail"; });
  return failed ? exit_status(ErrorKind::device) : 0;
}

}  // namespace

void add_bench(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("bench", "measure a device: bandwidth, products, solves, each verified");
  auto* study = command.add_flag("--study", options->study, "print the 2014 study's tables with our figures beside");
  command.add_option("--device", options->device, "device id, or several between commas: they take turns pass by pass")
      ->capture_default_str();
  command
      .add_flag("--peers", options->peers,
                "time OpenBLAS, Eigen, ViennaCL, CLBlast, cuBLAS and cuSPARSE, as far as they are there, on the same "
                "products")
      ->excludes(study);
  command.add_option("--scenes", options->scenes, "folder with the rooms");
  command.add_option("--room", options->rooms, "only the room with so many patches (may be given several times)")
      ->check(CLI::IsMember({1312U, 3360U, 9680U, 17128U}));
  command.add_option("--json", options->json, "write the rows as JSON")->check(file_name());
  command.add_option("--csv", options->csv, "write the rows as CSV")->check(file_name())->excludes(study);
  command.add_option("--repetitions", options->repetitions, "timed passes of each")
      ->check(number(0U, 1000U))
      ->capture_default_str();
  command.add_flag("--quiet", options->quiet, "no progress and no warnings");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
