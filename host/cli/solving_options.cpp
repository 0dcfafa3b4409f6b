#include "solving_options.h"

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
                  "device id, see 'interflect devices'; several, as cuda:0,openmp, are tried in this order when one "
                  "fails")
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

Candidates candidates_of(const SolvingOptions& options, ProgressSink& progress) {
  return {devices_of_rank(options.device), [](const std::string& id) { return open_device(id); }, &progress};
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
