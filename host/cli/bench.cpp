#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "bench_rows.h"
#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/registry.h"
#include "report.h"
#include "study.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  bool study = false;
  std::string device = "auto";
  std::string scenes;
  std::vector<unsigned> rooms;
  std::string json, csv;
  unsigned repetitions = 15;
  bool quiet = false;
};

std::vector<BenchRow> bandwidth_rows(const std::string& id, unsigned repetitions) {
  constexpr std::uint64_t bytes = std::uint64_t{512} << 20;  // far beyond any cache
  std::vector<BenchRow> rows;
  for (const Rate& rate : measure_bandwidth(*open_device(id), bytes, static_cast<int>(repetitions))) {
    BenchRow row;
    row.device = id;
    row.what = rate.what;
    row.seconds = rate.seconds;
    row.seconds_min = rate.seconds_min;
    row.seconds_max = rate.seconds_max;
    row.bytes = rate.bytes;
    row.status = rate.verified ? "pass" : "fail";
    row.reason = rate.reason;
    rows.push_back(row);
  }
  return rows;
}

nlohmann::ordered_json header(const DeviceInfo& info, unsigned repetitions) {
  return {{"interflect", INTERFLECT_VERSION},
          {"device", info.id},
          {"name", info.name},
          {"driver", info.driver},
          {"compute_units", info.compute_units},
          {"repetitions", repetitions},
          {"statistic", "median, minimum and maximum; a_ratio is the median of ratios of neighbouring passes"}};
}

void write_files(const Options& options, const nlohmann::ordered_json& head, const std::vector<BenchRow>& rows) {
  if (!options.json.empty()) {
    nlohmann::ordered_json out;
    out["header"] = head;
    out["rows"] = nlohmann::ordered_json::array();
    for (const BenchRow& row : rows) out["rows"].push_back(to_json(row));
    AtomicFile file(options.json);
    file.write(dump(out));
    file.commit();
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
  const DeviceInfo info = open_device(options.device)->info();
  const std::string folder = scenes_folder(options.scenes);
  if (options.study) {
    const StudyTable table = study_table(folder, info.id, std::max(1U, options.repetitions / 3), console);
    fmt::print("{}", table.text);
    return table.verified ? 0 : exit_status(ErrorKind::device);
  }
  const auto head = header(info, options.repetitions);
  fmt::print("{} ({}), {}, {} compute units, {} repetitions\n{}", info.id, info.name, info.driver, info.compute_units,
             options.repetitions, text_header());
  std::vector<BenchRow> rows;
  const auto add = [&](const std::vector<BenchRow>& more) {
    for (const BenchRow& row : more) fmt::print("{}", to_text(row));
    std::fflush(stdout);
    rows.insert(rows.end(), more.begin(), more.end());
  };
  add(bandwidth_rows(info.id, options.repetitions));
  for (const Room& room : study_rooms()) {
    const bool wanted = options.rooms.empty() ||
                        std::find(options.rooms.begin(), options.rooms.end(), room.patches) != options.rooms.end();
    if (wanted) add(bench_room(folder, room, info.id, options.repetitions, console));
  }
  write_files(options, head, rows);
  const bool failed = std::any_of(rows.begin(), rows.end(), [](const BenchRow& row) { return row.status == "fail"; });
  return failed ? exit_status(ErrorKind::device) : 0;
}

}  // namespace

void add_bench(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("bench", "measure a device: bandwidth, products, solves, each verified");
  auto* study =
      command.add_flag("--study", options->study, "print the 2014 study's first table with our figures beside");
  command.add_option("--device", options->device, "device id")->capture_default_str();
  command.add_option("--scenes", options->scenes, "folder with the rooms");
  command.add_option("--room", options->rooms, "only the room with so many patches (may be given several times)")
      ->check(CLI::IsMember({1312U, 3360U, 9680U, 17128U}))
      ->excludes(study);
  command.add_option("--json", options->json, "write the rows as JSON")->check(file_name())->excludes(study);
  command.add_option("--csv", options->csv, "write the rows as CSV")->check(file_name())->excludes(study);
  command.add_option("--repetitions", options->repetitions, "timed passes of each")
      ->check(number(0U, 1000U))
      ->capture_default_str();
  command.add_flag("--quiet", options->quiet, "no progress and no warnings");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
