#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "pipeline.h"
#include "place.h"
#include "report.h"

namespace interflect::cli {

namespace {

struct Options {
  SceneOptions scene;
  std::string device = "openmp";
  std::string assembly = "auto";
  bool between = false;
  bool json = false;
};

std::string shown(const std::string& name) {
  return name.empty() ? "(unnamed)" : name;
}

void print_table(const GroupFactors& table) {
  std::size_t widest = 9;
  for (const std::string& group : table.groups) widest = std::max(widest, shown(group).size());
  widest = std::min<std::size_t>(widest, 24);
  const auto cell = [&](const std::string& text) { return fmt::format("{:>{}.{}}", text, widest, widest); };
  fmt::print("{}  {}", cell("from \\ to"), cell("area"));
  for (const std::string& group : table.groups) fmt::print("  {}", cell(shown(group)));
  fmt::print("  {}\n", cell("sum"));
  for (std::size_t a = 0; a < table.groups.size(); ++a) {
    fmt::print("{}  {:>{}.6g}", cell(shown(table.groups[a])), table.areas[a], widest);
    double sum = 0;
    for (const double f : table.factors[a]) {
      fmt::print("  {:>{}.6f}", f, widest);
      sum += f;
    }
    fmt::print("  {:>{}.6f}\n", sum, widest);
  }
}

int run(const Options& options) {
  Console console(options.scene.quiet);
  const MeshedScene loaded = load(options.scene, console);
  Candidates candidates(
      choose_devices(options.device), [](const std::string& id) { return open_device(id); }, &console);
  AssemblyUse place;
  const FormFactors factors = assemble_by(candidates, assembly_place(options.assembly), loaded.mesh,
                                          assembly_options(options.scene), place, console);
  say(factors.report, loaded.scene, console);
  if (options.between) {
    const GroupFactors table = between(factors.matrix, loaded.mesh, loaded.grouping);
    if (options.json) {
      nlohmann::ordered_json out;
      out["groups"] = table.groups;
      out["areas"] = table.areas;
      out["factors"] = table.factors;
      fmt::print("{}", dump(out));
    } else {
      print_table(table);
    }
    return 0;
  }
  if (options.json) {
    nlohmann::ordered_json out;
    out["scene"] = loaded.scene.file;
    out["patches"] = loaded.mesh.size();
    out["divide"] = loaded.divide;
    out["seconds"] = factors.report.seconds;
    out["assembly"] = assembly_json(factors.report, place);
    out["nonzero_fraction"] = factors.matrix.nonzero_fraction();
    out["closure"] = closure_json(factors.report, loaded);
    fmt::print("{}", dump(out));
    return 0;
  }
  fmt::print("scene          {}: {} patches (--divide {:.6g})\n", loaded.scene.file, loaded.mesh.size(), loaded.divide);
  fmt::print("form factors   {:.2f} s on {}, {} facing pairs, {} by the contour form, {} rays\n",
             factors.report.seconds, place.device, factors.report.pairs_considered, factors.report.pairs_analytic,
             factors.report.rays);
  fmt::print("{}", closure_text(factors.report));
  return 0;
}

}  // namespace

void add_formfactors(CLI::App& program, Action& action) {
  auto options = std::make_shared<Options>();
  CLI::App& command = *program.add_subcommand("formfactors", "compute form factors and say how good they are");
  add_scene_options(command, options->scene);
  command.add_option("--device", options->device, "device id, several, or auto, as for solve; see --assembly")
      ->capture_default_str();
  add_assembly_option(command, options->assembly);
  command.add_flag("--between", options->between, "print the factors between groups (see --group-by)");
  command.add_flag("--json", options->json, "print JSON");
  command.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace interflect::cli
