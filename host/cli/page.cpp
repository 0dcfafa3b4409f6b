#include "page.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace interflect::cli {

namespace {

std::string seconds(double value) {
  return fmt::format("{:.3g} s", value);
}

std::string solved_as(const SolveSummary& summary) {
  if (summary.stop.iterations) return fmt::format("{} iterations, as asked", *summary.stop.iterations);
  return summary.solved->report.converged ? "converged" : "NOT CONVERGED";
}

}  // namespace

std::optional<std::uint32_t> bounces_for_page(std::size_t patches, std::size_t groups) {
  constexpr std::uint64_t wanted = 12;
  const std::uint64_t each = std::uint64_t{6} * patches * std::max<std::size_t>(1, groups);
  const std::uint64_t fit = PageOptions{}.largest_bounces / each;  // the light of no bounce is one of them
  if (fit < 2) return std::nullopt;
  return static_cast<std::uint32_t>(std::min(wanted, fit - 1));
}

PageOptions page_options(const SolveSummary& summary) {
  const MeshedScene& loaded = *summary.loaded;
  const SolveReport& report = summary.solved->report;
  const StorageUse& storage = summary.solved->storage;
  PageOptions options;
  options.title = loaded.scene.name;
  options.camera = loaded.scene.camera;
  options.complete = report.converged;
  for (const Material& material : loaded.scene.materials) options.materials.push_back(material.name);
  const auto add = [&](const char* name, std::string value) { options.statistics.push_back({name, std::move(value)}); };
  add("Triangles", fmt::format("{}", loaded.scene.triangles.size()));
  add("Patches", fmt::format("{}", loaded.mesh.size()));
  add("Method", std::string(name(summary.method)));
  add("Result", solved_as(summary));
  add("Iterations", fmt::format("{}", report.iterations));
  add("Products", fmt::format("{}", report.products));
  add("Residual", fmt::format("{:.1e}", fmt::join(report.relative_residual, "  ")));
  add("Solve", seconds(report.seconds));
  add("Device", fmt::format("{}", fmt::join(summary.solved->devices, ", ")));
  add("Form factors", fmt::format("{} on {}", seconds(summary.assembled->seconds), summary.assembly.device));
  add("Storage", fmt::format("{}, {:.1f} MiB", name(storage.format), static_cast<double>(storage.bytes) / (1 << 20)));
  const RowSums& sums = summary.assembled->after;
  add("Row sums", fmt::format("{:.4f} to {:.4f}", sums.min, sums.max));
  add("Sampling error", fmt::format("{:.1e} rms", summary.radiosity_error.rms));
  add("Energy balance", fmt::format("{:.1e}", summary.energy.balance_error()));
  add("Interflect", INTERFLECT_VERSION);
  return options;
}

}  // namespace interflect::cli
