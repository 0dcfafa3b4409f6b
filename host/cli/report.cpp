#include "report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "certificate_report.h"
#include "interflect/device/compile_cache.h"

namespace interflect::cli {

using nlohmann::ordered_json;

namespace {

double sum(const Rgb& c) {
  return c[0] + c[1] + c[2];
}

std::string_view tone_of(const SolveSummary& summary) {
  if (summary.solved->report.interrupted) return "INTERRUPTED";
  if (summary.stop.iterations) return "fixed number of iterations";
  return summary.solved->report.converged ? "converged" : "NOT CONVERGED";
}

ordered_json row_sums_json(const RowSums& sums) {
  return {{"min", sums.min}, {"mean", sums.mean}, {"max", sums.max}};
}

ordered_json energy_json(const Energy& energy) {
  return {{"emitted", sum(energy.emitted)},
          {"absorbed", sum(energy.absorbed)},
          {"escaped", sum(energy.escaped)},
          {"balance_error", energy.balance_error()},
          {"per_channel", {{"emitted", energy.emitted}, {"absorbed", energy.absorbed}, {"escaped", energy.escaped}}}};
}

/// How many patches of which object are set aside: "table/leg": 12.
ordered_json set_aside_by_object(const AssemblyReport& report,
                                 const std::function<std::string(std::uint32_t)>& object_of) {
  std::map<std::string, std::uint32_t> counts;
  for (const std::uint32_t i : report.set_aside) ++counts[object_of(i)];
  ordered_json out = ordered_json::object();
  for (const auto& [name, count] : counts) out[name] = count;
  return out;
}

/// null where lamps were not told apart.
ordered_json light_groups_json(const std::vector<GroupResidual>& groups) {
  ordered_json out = nullptr;
  for (const GroupResidual& group : groups) {
    out.push_back({{"name", group.name},
                   {"patches", group.patches},
                   {"emitted", group.emitted},
                   {"relative_residual", group.relative_residual}});
  }
  return out;
}

/// Of devices that worked together; null for one.
ordered_json shares_json(const std::vector<DeviceShare>& shares) {
  ordered_json out = nullptr;
  for (const DeviceShare& share : shares) {
    out.push_back({{"device", share.device},
                   {"share", share.share},
                   {"bytes", share.bytes},
                   {"bytes_per_second", share.bytes_per_second},
                   {"busy_seconds", share.busy_seconds},
                   {"idle_seconds", share.idle_seconds},
                   {"moves", share.moves}});
  }
  return out;
}

std::string shares_text(const std::vector<DeviceShare>& shares) {
  std::string out;
  for (const DeviceShare& share : shares) {
    const double all = share.busy_seconds + share.idle_seconds;
    out += fmt::format("{:<14} {}: {:.1f} % of the form factors, {:.2f} GB/s, idle {:.1f} % of the products\n",
                       out.empty() ? "shares" : "", share.device, 100 * share.share, 1e-9 * share.bytes_per_second,
                       all > 0 ? 100 * share.idle_seconds / all : 0.0);
  }
  return out;
}

std::string light_groups_text(const std::vector<GroupResidual>& groups) {
  std::string out;
  for (const GroupResidual& group : groups) {
    out += fmt::format("{:<14} {}: {} patches, emitted {:.6g}, residual {:.2e}\n", out.empty() ? "light groups" : "",
                       group.name, group.patches, sum(group.emitted), fmt::join(group.relative_residual, " "));
  }
  return out;
}

/// null where one process did it all.
ordered_json ranks_json(const SolveSummary& summary) {
  if (!summary.ranks) return nullptr;
  const RanksReport& ranks = *summary.ranks;
  const double iterations = std::max(1U, summary.solved->report.iterations);
  const RanksUse& solve = ranks.solve;
  return {{"count", ranks.rows.size()},
          {"transport", ranks.transport},
          {"devices", ranks.devices},
          {"rows", ranks.rows},
          {"bytes_gathered", solve.bytes_gathered},
          {"messages", solve.messages},
          {"seconds_communicating", solve.seconds},
          {"bytes_per_iteration", static_cast<double>(solve.bytes_gathered) / iterations},
          {"messages_per_iteration", static_cast<double>(solve.messages) / iterations},
          {"form_factors",
           {{"bytes_exchanged", ranks.assembly.bytes_exchanged},
            {"bytes_gathered", ranks.assembly.bytes_gathered},
            {"messages", ranks.assembly.messages},
            {"seconds_communicating", ranks.assembly.seconds}}}};
}

std::string ranks_text(const SolveSummary& summary) {
  if (!summary.ranks) return "";
  const RanksReport& ranks = *summary.ranks;
  const auto [fewest, most] = std::minmax_element(ranks.rows.begin(), ranks.rows.end());
  return fmt::format("ranks          {} through {}, {} to {} rows each; {:.3f} s in {} messages of the solve\n",
                     ranks.rows.size(), ranks.transport, *fewest, *most, ranks.solve.seconds, ranks.solve.messages);
}

}  // namespace

ordered_json closure_json(const AssemblyReport& report, const MeshedScene& loaded) {
  return closure_json(report, [&](std::uint32_t i) {
    const Surface& surface = loaded.mesh.surfaces[loaded.mesh.surface[i]];
    return surface.object.empty() ? surface.group : surface.object;
  });
}

ordered_json closure_json(const AssemblyReport& report, const std::function<std::string(std::uint32_t)>& object_of) {
  ordered_json out = row_sums_json(report.after);
  out["before"] = row_sums_json(report.before);
  out["applied"] = report.closure_applied;
  out["iterations"] = report.closure_iterations;
  out["max_change"] = report.closure_max_change;
  out["closed_scene"] = report.closed_scene;
  out["escape_fraction"] = report.escape_fraction;
  out["back_fraction"] = report.back_fraction;
  out["set_aside"] = {{"count", report.set_aside.size()},
                      {"by_object", set_aside_by_object(report, object_of)},
                      {"patches", report.set_aside}};
  out["moved"] = moved_json(report);
  out["certificate"] = certificate_json(report.certificate);
  return out;
}

ordered_json assembly_json(const AssemblyReport& report, const AssemblyUse& use) {
  return {{"device", use.device},
          {"bytes_over_bus", use.bytes_over_bus},
          {"pairs_considered", report.pairs_considered},
          {"pairs_analytic", report.pairs_analytic},
          {"rays", report.rays}};
}

ordered_json error_json(const EstimatedError& error) {
  return {{"rms", error.rms}, {"max", error.max}};
}

ordered_json kept_json(const Kept& kept) {
  if (kept.file.empty()) return nullptr;
  return {{"file", kept.file},    {"done", kept.done}, {"panels", kept.panels},    {"panels_reused", kept.reused},
          {"accuracy", kept.eps}, {"seed", kept.seed}, {"geometry", kept.geometry}};
}

std::string kept_text(const Kept& kept) {
  if (kept.file.empty()) return "";
  return fmt::format("kept           {}: {}, {} of {} panels from there, accuracy {}, seed {}\n", kept.file, kept.done,
                     kept.reused, kept.panels, text_of({kept.eps}), kept.seed);
}

ordered_json to_json(const SolveSummary& summary) {
  const MeshedScene& loaded = *summary.loaded;
  const AssemblyReport& assembled = *summary.assembled;
  const SolveReport& report = summary.solved->report;
  ordered_json out;
  out["interflect"] = INTERFLECT_VERSION;
  out["scene"] = loaded.scene.file;
  out["patches"] = loaded.mesh.size();
  out["triangles"] = loaded.scene.triangles.size();
  out["divide"] = loaded.divide;
  out["method"] = std::string(name(summary.method));
  out["tolerance"] = summary.stop.tolerance;
  out["converged"] = report.converged;
  if (!report.reason.empty()) out["reason"] = report.reason;
  out["interrupted"] = report.interrupted;
  out["iterations"] = report.iterations;
  out["products"] = report.products;
  out["relative_residual"] = report.relative_residual;
  out["light_groups"] = light_groups_json(summary.solved->groups);
  out["devices"] = summary.solved->devices;
  out["shares"] = shares_json(summary.solved->shares);
  out["ranks"] = ranks_json(summary);
  out["failures"] = ordered_json::array();
  for (const DeviceFailure& failure : summary.solved->failures) {
    out["failures"].push_back({{"device", failure.device}, {"reason", failure.reason}});
  }
  const CompileStatistics kernels = compile_statistics();
  out["kernels"] = {{"compiled", kernels.compiled}, {"from_cache", kernels.from_cache}};
  const StorageUse& storage = summary.solved->storage;
  out["storage"] = {
      {"format", std::string(name(storage.format))},
      {"bytes", storage.bytes},
      {"nonzero_fraction", storage.nonzero_fraction},
      {"rounding_error",
       storage.rounding_error ? nlohmann::ordered_json(*storage.rounding_error) : nlohmann::ordered_json(nullptr)},
      {"refused", storage.refused.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(storage.refused)}};
  if (storage.streamed) {
    const StreamUse& use = *storage.streamed;
    out["storage"]["streamed"] = {{"panels", use.panels},
                                  {"resident", use.resident},
                                  {"bytes_read", use.bytes_read},
                                  {"bytes_read_per_product", use.bytes_read / std::max<std::uint64_t>(1, use.passes)},
                                  {"seconds_waiting", use.seconds_waiting}};
  }
  out["seconds"] = {{"read", loaded.read_seconds},
                    {"mesh", loaded.mesh_seconds},
                    {"form_factors", assembled.seconds},
                    {"pack", storage.pack_seconds},
                    {"upload", summary.solved->upload_seconds},
                    {"compile", kernels.seconds},
                    {"solve", report.seconds},
                    {"estimate", summary.estimate_seconds},
                    {"write", summary.write_seconds},
                    {"total", summary.total_seconds}};
  out["closure"] = closure_json(assembled, loaded);
  out["energy"] = energy_json(summary.energy);
  out["assembly"] = assembly_json(assembled, summary.assembly);
  out["form_factors"] = kept_json(summary.kept);
  out["checkpoint"] = checkpoint_json(summary.checkpoint);
  out["estimated_error"] = {{"row_sum", error_json(summary.row_error)},
                            {"radiosity", error_json(summary.radiosity_error)}};
  out["warnings"] = loaded.warnings;
  for (const std::string& warning : assembled.warnings) out["warnings"].push_back(warning);
  return out;
}

std::string closure_text(const AssemblyReport& report) {
  const auto line = [](const RowSums& sums) {
    return fmt::format("{:.5f} / {:.5f} / {:.5f}", sums.min, sums.mean, sums.max);
  };
  std::string out = fmt::format("row sums       {} (min / mean / max) as computed\n", line(report.before));
  if (report.closure_applied) {
    out +=
        fmt::format("               {} after closure, {} iterations\n", line(report.after), report.closure_iterations);
  }
  if (!report.closed_scene) {
    out += fmt::format("open scene     {:.1f} % of the light that leaves a surface meets no other\n",
                       report.escape_fraction * 100);
  }
  if (!report.set_aside.empty()) {
    out += fmt::format("set aside      {} patches that see next to nothing\n", report.set_aside.size());
  }
  return out + certificate_text(report.certificate);
}

std::string rounding_text(const StorageUse& storage) {
  if (storage.format == Storage::dense32) return "";
  const std::string packed = fmt::format(", packed in {:.2f} s", storage.pack_seconds);
  if (!storage.rounding_error) return packed + ", the error of its rounding was not measured";
  return packed +
         fmt::format(", its rounding moves a radiosity by at most {:.1e} of the largest", *storage.rounding_error);
}

std::string stream_text(const StorageUse& storage) {
  if (!storage.streamed) return "";
  const StreamUse& use = *storage.streamed;
  const std::uint64_t each = use.bytes_read / std::max<std::uint64_t>(1, use.passes);
  return fmt::format("streamed       {} of {} panels in memory, {:.1f} MiB read per product, {:.2f} s waiting for it\n",
                     use.resident, use.panels, static_cast<double>(each) / (1 << 20), use.seconds_waiting);
}

std::string to_text(const SolveSummary& summary) {
  const MeshedScene& loaded = *summary.loaded;
  const SolveReport& report = summary.solved->report;
  std::string out = fmt::format("scene          {}: {} triangles, {} patches (--divide {:.6g})\n", loaded.scene.file,
                                loaded.scene.triangles.size(), loaded.mesh.size(), loaded.divide);
  const StorageUse& storage = summary.solved->storage;
  out += fmt::format("form factors   {:.2f} s on {}, {:.1f} % non-zero\n", summary.assembled->seconds,
                     summary.assembly.device, 100 * storage.nonzero_fraction);
  out += kept_text(summary.kept);
  out += fmt::format("storage        {}, {:.1f} MiB{}\n", name(storage.format),
                     static_cast<double>(storage.bytes) / (1 << 20), rounding_text(storage));
  out += stream_text(storage);
  out += closure_text(*summary.assembled);
  out += fmt::format("solve          {} on {}: {}, {} iterations, {} products, {:.3f} s\n", name(summary.method),
                     fmt::join(summary.solved->devices, ","), tone_of(summary), report.iterations, report.products,
                     report.seconds);
  out += shares_text(summary.solved->shares);
  out += ranks_text(summary);
  out += checkpoint_text(summary.checkpoint);
  for (const DeviceFailure& failure : summary.solved->failures) {
    out += fmt::format("failed         {}\n", first_line(failure.reason));
  }
  const CompileStatistics kernels = compile_statistics();
  if (kernels.compiled + kernels.from_cache > 0) {
    out += fmt::format("kernels        {} compiled, {} from the cache, {:.2f} s\n", kernels.compiled,
                       kernels.from_cache, kernels.seconds);
  }
  out += fmt::format("residual       {:.2e} (relative, per channel{})\n", fmt::join(report.relative_residual, " "),
                     summary.solved->groups.empty() ? "" : ", of the worst light group");
  out += light_groups_text(summary.solved->groups);
  out += fmt::format(
      "sampling       row sums {:.1e} rms, {:.1e} at most; a radiosity {:.1e} rms, {:.1e} of the largest\n",
      summary.row_error.rms, summary.row_error.max, summary.radiosity_error.rms, summary.radiosity_error.max);
  out += fmt::format("energy         emitted {:.6g}, absorbed {:.6g}, escaped {:.6g}, balance error {:.1e}\n",
                     sum(summary.energy.emitted), sum(summary.energy.absorbed), sum(summary.energy.escaped),
                     summary.energy.balance_error());
  return out;
}

std::string_view first_line(std::string_view text) {
  return text.substr(0, text.find('\n'));
}

std::string dump(const ordered_json& value) {
  return value.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace interflect::cli
