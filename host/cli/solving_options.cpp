#include "solving_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "interflect/schedule/storage_choice.h"
#include "kept.h"
#include "rank_solve.h"
#include "validators.h"

namespace interflect::cli {

Method SolvingOptions::chosen_method() const {
  return method == "cg" ? Method::cg : method == "bicgstab" ? Method::bicgstab : Method::jacobi;
}

void add_solving_options(CLI::App& command, SolvingOptions& options) {
  command
      .add_option("--form-factors", options.form_factors,
                  "keep the form factors in this file (.iff), and take them from it when it fits the scene")
      ->check(file_name());
  command
      .add_option("--device", options.device,
                  "device id, see 'interflect devices'; several, as cuda:0,openmp, work together, and what one that "
                  "fails had goes to the others; all: every real device; auto: the fastest, and the next one when it "
                  "fails")
      ->capture_default_str();
  command
      .add_option(
          "--split", options.split,
          "the devices' shares of the form factors, in the order of --device, such as 4,1; auto: as their rates "
          "are measured to be")
      ->capture_default_str();
  command.add_option("--method", options.method, "cg, bicgstab or jacobi")
      ->check(CLI::IsMember({"cg", "bicgstab", "jacobi"}))
      ->capture_default_str();
  command.add_option("--tol", options.stop.tolerance, "relative residual to reach in every channel")
      ->check(number(0.0, 1.0))
      ->capture_default_str();
  auto* most = command.add_option("--max-iterations", options.stop.max_iterations, "give up after so many")
                   ->check(count(10'000'000))
                   ->capture_default_str();
  command.add_option("--iterations", options.stop.iterations, "exactly so many iterations, whatever the residual")
      ->check(count(10'000'000))
      ->excludes(most);
  command
      .add_option("--storage", options.storage, "storage of the form factors: auto, dense32, dense16, tiled16, sym16")
      ->check(CLI::IsMember({"auto", "dense32", "dense16", "tiled16", "sym16"}))
      ->capture_default_str();
  add_assembly_option(command, options.assembly);
}

namespace {

/// The numbers of --split. Throws a usage Error for other than one for each device.
std::vector<double> weights_of(const std::string& text, std::size_t devices) {
  if (text == "auto") return {};
  std::vector<double> weights;
  std::istringstream list(text);
  for (std::string item; std::getline(list, item, ',');) {
    std::size_t used = 0;
    double weight = -1;
    try {
      weight = std::stod(item, &used);
    } catch (const std::exception&) {
    }
    if (used != item.size() || !(weight >= 0) || !std::isfinite(weight)) {
      throw Error(ErrorKind::usage, fmt::format("--split {}: '{}' is no share such as 4 or 0.5", text, item));
    }
    weights.push_back(weight);
  }
  if (weights.size() != devices) {
    throw Error(ErrorKind::usage, fmt::format("--split {}: {} shares for {} devices", text, weights.size(), devices));
  }
  if (std::all_of(weights.begin(), weights.end(), [](double weight) { return weight == 0; })) {
    throw Error(ErrorKind::usage, fmt::format("--split {}: one share must be above 0", text));
  }
  return weights;
}

}  // namespace

std::optional<SplitOptions> together_of(const SolvingOptions& options, std::size_t devices) {
  if (options.split != "auto" && ranks().size() > 1) {
    throw Error(ErrorKind::usage, "--split: not on several ranks yet: start it without mpirun");
  }
  if (options.device != "auto") return SplitOptions{.weights = weights_of(options.split, devices), .said = {}};
  if (options.split == "auto") return std::nullopt;
  throw Error(ErrorKind::usage, "--split needs the devices that share: --device with their ids, or all");
}

Candidates candidates_of(const SolvingOptions& options, ProgressSink& progress) {
  std::vector<std::string> ids = devices_of_rank(options.device);
  std::optional<SplitOptions> together = together_of(options, ids.size());
  return {std::move(ids), [](const std::string& id) { return open_device(id); }, &progress, std::move(together)};
}

PlacedSolve solve_loaded(const MeshedScene& loaded, const SceneOptions& scene, const SolvingOptions& options,
                         Candidates& candidates, ProgressSink& progress, const Lamps& lamps) {
  if (ranks().size() > 1) return solve_on_ranks(loaded, scene, options, candidates, progress, lamps);
  Assembler assembler(candidates, assembly_place(options.assembly));
  const auto storage = storage_of(options.storage);
  const Method method = options.chosen_method();
  return options.form_factors.empty()
             ? assemble_and_solve(loaded, scene, assembler, storage, method, options.stop, progress, lamps)
             : solve_kept(options.form_factors, loaded, scene, assembler, storage, method, options.stop, progress,
                          lamps);
}

}  // namespace interflect::cli
