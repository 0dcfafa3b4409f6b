#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>

#include "bench_assembly.h"
#include "bench_compare.h"
#include "bench_header.h"
#include "bench_hybrid.h"
#include "bench_plot.h"
#include "bench_read.h"
#include "bench_rows.h"
#include "bench_stored.h"
#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/device/registry.h"
#include "interflect/schedule/storage_choice.h"
#include "power_law.h"
#include "report.h"
#include "study.h"
#include "tune.h"
#include "validators.h"

namespace interflect::cli {

namespace {

struct Options {
  bool study = false, peers = false, assembly = false, hybrid = false;
  std::string device = "auto";
  std::string scenes, scene;
  std::string accuracy = "medium";
  std::vector<unsigned> rooms;
  std::string storage = "dense32,sym16";
  std::uint32_t random = 0;
  bool growth = false;
  std::uint32_t growth_max = 32000;
  std::string json, csv, plot, compare, from;
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

/// Rooms that are asked for: all, or those that are named; none of its own accord when something else is asked for.
bool wanted(const Options& options, const Room& room) {
  if (options.rooms.empty()) return !options.growth && options.random == 0;
  return std::find(options.rooms.begin(), options.rooms.end(), room.patches) != options.rooms.end();
}

/// The rooms, the scene that is named, and the sizes of --growth, assembled instead of multiplied with.
void assemblies(const Options& options, const BenchPlan& plan, Console& console, const RowSink& add) {
  AssemblyPlan assembly{plan.devices, {}, plan.repetitions, false};
  assembly.options.budget = budget_of(accuracy_of(options.accuracy));
  const auto file = [&](const char* name) { return (std::filesystem::path(plan.folder) / name).string(); };
  SceneOptions scene;
  for (const Room& room : study_rooms()) {
    if (!options.scene.empty() && options.rooms.empty()) break;
    if (!wanted(options, room)) continue;
    scene.file = file(room.file);
    scene.divide = room.divide;
    add(bench_assembly(assembly, scene, "", console));
  }
  if (!options.scene.empty()) {
    scene.file = options.scene;
    scene.divide = 1;
    add(bench_assembly(assembly, scene, "", console));
  }
  scene.file = file("room-1312.obj");
  scene.divide.reset();
  assembly.growth = true;
  for (std::uint32_t n = 1000; options.growth && n <= options.growth_max; n *= 2) {
    scene.patches = n;
    add(bench_assembly(assembly, scene, "", console));
  }
}

BenchRun measured(const Options& options, const std::vector<std::string>& ids, Console& console) {
  std::vector<DeviceInfo> infos;
  infos.reserve(ids.size());
  for (const std::string& id : ids) infos.push_back(info_of(id, ids.size() == 1));
  BenchPlan plan{scenes_folder(options.scenes), ids,           parse_storages(options.storage),
                 options.repetitions,           options.peers, 0};
  BenchRun run;
  run.header = bench_header(infos, options.repetitions);
  fmt::print("{}{}", header_text(run.header), text_header());
  const RowSink add = [&](const std::vector<BenchRow>& more) {
    for (const BenchRow& row : more) fmt::print("{}", to_text(row));
    std::fflush(stdout);
    run.rows.insert(run.rows.end(), more.begin(), more.end());
  };
  if (options.assembly) {
    assemblies(options, plan, console, add);
    set_spread(run.header, run.rows);
    return run;
  }
  if (options.hybrid) {
    constexpr std::uint32_t usual = 8192;
    add(bench_hybrid(ids, options.random > 0 ? options.random : usual, options.repetitions));
    set_spread(run.header, run.rows);
    return run;
  }
  const std::vector<BenchRow> devices = bench_devices(ids, options.repetitions);
  add(devices);
  const auto prepare = [&](std::uint32_t n) {
    tune_on_first_use(ids, plan.storages, n, console);
    plan.block = sym16_block(infos.front(), n);
  };
  for (const Room& room : study_rooms()) {
    if (!wanted(options, room)) continue;
    prepare(room.patches);
    add(bench_room(plan, room, devices, console));
  }
  if (options.random > 0) {
    prepare(options.random);
    add(bench_random(plan, options.random, devices));
  }
  plan.block = sym16_block(infos.front(), 0);  // of any size
  if (options.growth) bench_growth(plan, options.growth_max, devices, console, add);
  set_spread(run.header, run.rows);
  return run;
}

/// A file's run, printed as if it had been measured now.
BenchRun read_back(const std::string& file) {
  BenchRun run = read_bench(file);
  fmt::print("{}{}", header_text(run.header), text_header());
  for (const BenchRow& row : run.rows) fmt::print("{}", to_text(row));
  return run;
}

void write_file(const std::string& name, const std::string& content) {
  AtomicFile file(name);
  file.write(content);
  file.commit();
}

void write_files(const Options& options, const BenchRun& run, const std::vector<Growth>& growth,
                 const std::vector<Compared>& compared) {
  if (!options.json.empty()) {
    nlohmann::ordered_json out;
    out["header"] = run.header;
    out["rows"] = nlohmann::ordered_json::array();
    for (const BenchRow& row : run.rows) out["rows"].push_back(to_json(row));
    if (!growth.empty()) out["growth"] = growth_json(growth);
    if (!options.compare.empty()) out["compared"] = {{"with", options.compare}, {"rows", compare_json(compared)}};
    write_file(options.json, dump(out));
  }
  if (!options.csv.empty()) {
    std::string lines = csv_header();
    for (const BenchRow& row : run.rows) lines += to_csv(row);
    write_file(options.csv, lines);
  }
  if (!options.plot.empty()) write_file(options.plot, plot(run, options.plot));
}

int run_study(const Options& options, const std::string& id, Console& console) {
  const unsigned passes = std::max(1U, options.repetitions / 3);
  const auto head = bench_header({info_of(id, true)}, passes);
  const StudyTables tables = study_tables(scenes_folder(options.scenes), id, passes, options.rooms, console);
  fmt::print("{}", tables.text);
  if (!options.json.empty()) {
    nlohmann::ordered_json out = {{"header", head}};
    out.update(tables.data);
    write_file(options.json, dump(out));
  }
  return tables.verified ? 0 : exit_status(ErrorKind::device);
}

/// What can be wrong with the options is found here, before the work.
void check_files(const Options& options) {
  if (!options.plot.empty()) check_plot_name(options.plot);
  static_cast<void>(parse_storages(options.storage));
  for (const std::string& file : {options.json, options.csv, options.plot}) {
    if (!file.empty()) const AtomicFile probe(file);
  }
}

int run(const Options& options) {
  Console console(options.quiet);
  check_files(options);
  const BenchRun old = options.compare.empty() ? BenchRun{} : read_bench(options.compare);
  BenchRun now;
  if (!options.from.empty()) {
    now = read_back(options.from);
  } else {
    std::vector<std::string> ids = choose_devices(options.device);
    if (options.device == "auto") ids.resize(1);
    if (options.study) return run_study(options, ids.front(), console);
    now = measured(options, ids, console);
  }
  const std::vector<Growth> growth = growth_of(now.rows);
  fmt::print("{}{}", growth_text(growth), spread_text(now.header));
  std::vector<Compared> compared;
  if (!options.compare.empty()) {
    compared = compare(old.rows, now.rows);
    fmt::print("\ncompared with {}\n{}", options.compare, compare_text(compared));
  }
  write_files(options, now, growth, compared);
  const bool failed =
      std::any_of(now.rows.begin(), now.rows.end(), [](const BenchRow& row) { return row.status == "fail"; });
  return failed ? exit_status(ErrorKind::device) : 0;
}

void add_measuring(CLI::App& command, Options& options) {
  command.add_option("--device", options.device, "device id, or several between commas: they take turns pass by pass")
      ->capture_default_str();
  command.add_flag(
      "--peers", options.peers,
      "time OpenBLAS, Eigen, ViennaCL, CLBlast, cuBLAS and cuSPARSE, as far as they are there, on the same "
      "products");
  command.add_option("--scenes", options.scenes, "folder with the rooms");
  command.add_option("--room", options.rooms, "only the room with so many patches (may be given several times)")
      ->check(CLI::IsMember({1312U, 3360U, 9680U, 17128U}));
  command.add_option("--storage", options.storage, "how F is stored: one, several between commas, or all")
      ->capture_default_str();
  command
      .add_option("--random", options.random,
                  "products of a dense random matrix of so many patches; instead of the rooms unless --room names some")
      ->check(number(0U, 1U << 20U));
  command.add_flag("--growth", options.growth,
                   "a product of one room at 1k, 2k, 4k, ... 32k patches, and the exponents of its time and bytes; "
                   "instead of the rooms unless --room names some");
  command.add_option("--growth-max", options.growth_max, "end --growth at so many patches")
      ->check(number(0U, 1'000'000U))
      ->capture_default_str();
  command.add_flag("--assembly", options.assembly,
                   "the form factors themselves instead of products with them: of the rooms, of --scene, of --growth's "
                   "sizes; the Embree path and devices in turn");
  command.add_flag(
      "--hybrid", options.hybrid,
      "devices together, against each alone: a slowed device and one of a quarter of its rate, then those of "
      "--device; products of a random matrix (of --random patches)");
  command.add_option("--scene", options.scene, "with --assembly: a scene file, cut with --divide 1")
      ->check(file_name())
      ->needs("--assembly");
  command.add_option("--accuracy", options.accuracy, "with --assembly: low, medium, high, or a row sum's rms error")
      ->needs("--assembly")
      ->capture_default_str();
  command.add_option("--repetitions", options.repetitions, "timed passes of each")
      ->check(number(0U, 1000U))
      ->capture_default_str();
}

void add_files(CLI::App& command, Options& options) {
  command.add_option("--json", options.json, "write header and rows as JSON")->check(file_name());
  command.add_option("--csv", options.csv, "write the rows as CSV")->check(file_name());
  command.add_option("--plot", options.plot, "draw them: FILE.html or FILE.svg")->check(file_name());
  command
      .add_option("--compare", options.compare,
                  fmt::format("a file of an earlier --json: old and new median of each row. A row is slower or faster "
                              "when the medians differ by more than the interquartile ranges of both together and by "
                              "more than {:.0f} % of the old one; rows of one pass are not judged",
                              100 * least_change))
      ->check(file_name());
  command.add_option("--from", options.from, "measure nothing: take the rows from a file of an earlier --json")
      ->check(file_name());
}

}  // namespace

void add_bench(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("bench", "measure a device: bandwidth, products, solves, each verified");
  auto* study = command.add_flag("--study", options->study, "print the 2014 study's tables with our figures beside");
  add_measuring(command, *options);
  add_files(command, *options);
  for (const char* other :
       {"--peers", "--storage", "--random", "--growth", "--assembly", "--csv", "--plot", "--compare", "--from"}) {
    study->excludes(command.get_option(other));
  }
  for (const char* other : {"--peers", "--room", "--storage", "--growth", "--assembly", "--study", "--from"}) {
    command.get_option("--hybrid")->excludes(command.get_option(other));
  }
  for (const char* other : {"--peers", "--random"})
    command.get_option("--assembly")->excludes(command.get_option(other));
  for (const char* other : {"--peers", "--room", "--storage", "--random", "--growth", "--growth-max", "--device",
                            "--scenes", "--assembly"}) {
    command.get_option("--from")->excludes(command.get_option(other));
  }
  command.add_flag("--quiet", options->quiet, "no progress and no warnings");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
