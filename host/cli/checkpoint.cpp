#include "checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <span>

#include "interflect/base/error.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/formfactor/iff_format.h"
#include "validators.h"

namespace interflect::cli {

namespace {

/// Seconds; nothing where the text is no duration.
std::optional<double> duration(std::string_view text) {
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [next, status] = std::from_chars(text.data(), end, value);
  if (status != std::errc{} || !std::isfinite(value) || value < 0) return std::nullopt;
  const std::string_view unit(next, static_cast<std::size_t>(end - next));
  if (unit.empty() || unit == "s") return value;
  if (unit == "min" || unit == "m") return 60 * value;
  if (unit == "h") return 3600 * value;
  return std::nullopt;
}

CLI::Validator a_duration() {
  return CLI::Validator(
      [](std::string& text) {
        return duration(text) ? std::string{} : fmt::format("'{}' is not a time such as 30s, 2min or 1h", text);
      },
      "TIME");
}

/// Of what K iterations depend on besides the columns: how F is made, and how it is stored.
std::uint64_t hash_of_exact(const SceneOptions& scene, const SolvingOptions& solving) {
  double eps = accuracy_asked(scene).eps;
  std::uint64_t seed = assembly_options(scene).seed;
  std::error_code missing;
  if (!solving.form_factors.empty() && std::filesystem::exists(solving.form_factors, missing)) {
    const iff::Key key = IffFile::open_panels(solving.form_factors).shape().key;
    eps = key.eps;
    seed = key.seed;
  }
  const std::string text = fmt::format("{} {} {} {}", eps, seed, scene.closure, solving.storage);
  return std::max<std::uint64_t>(1, iff::checksum(std::as_bytes(std::span(text))));
}

}  // namespace

void add_checkpoint_options(CLI::App& command, CheckpointOptions& options) {
  auto* file =
      command
          .add_option("--checkpoint", options.file,
                      "keep how far the solve has come in this file; the same command goes on from there, also "
                      "on another device")
          ->check(file_name());
  command.add_option("--every", options.every, "how often, such as 30s, 2min or 1h")
      ->check(a_duration())
      ->capture_default_str()
      ->needs(file);
}

double parse_duration(const std::string& text, const std::string& option) {
  if (const std::optional<double> seconds = duration(text)) return *seconds;
  throw Error(ErrorKind::usage, fmt::format("{}: '{}' is not a time such as 30s, 2min or 1h", option, text));
}

IterateKey key_of(const MeshedScene& loaded, const Lamps& lamps, const SceneOptions& scene,
                  const SolvingOptions& solving) {
  const Light light = light_of(loaded.mesh, lamps.groups);
  IterateKey key;
  key.patches = static_cast<std::uint32_t>(loaded.mesh.size());
  key.columns = static_cast<std::uint32_t>(light.emittance.size());
  key.method = solving.chosen_method();
  key.geometry = iff::geometry_hash(loaded.mesh);
  key.reflectance = hash_of(light.reflectance);
  key.emittance = hash_of(light.emittance);
  key.exactly = solving.stop.iterations ? hash_of_exact(scene, solving) : 0;
  return key;
}

CheckpointFile::CheckpointFile(const CheckpointOptions& options, const IterateKey& key, const StopTest& stop,
                               ProgressSink& progress)
    : key_(key), every_(parse_duration(options.every, "--every")), progress_(progress), use_{options.file} {
  std::error_code missing;
  if (!std::filesystem::exists(options.file, missing)) return;
  found_ = read_iterate(options.file, key);
  use_.iterations = found_->iterations();
  use_.products = found_->products;
  if (stop.iterations && use_.iterations > *stop.iterations) {
    throw input_error(options.file, 0,
                      fmt::format("has {} iterations, and --iterations asks for {}: remove it to begin anew",
                                  use_.iterations, *stop.iterations));
  }
  progress.message(fmt::format("{}: going on after {} iterations", options.file, use_.iterations));
}

void CheckpointFile::keep(const Iterate& iterate) noexcept {
  since_.restart();
  try {
    write_iterate(use_.file, key_, iterate);
  } catch (const std::exception& error) {
    if (told_) return;
    told_ = true;
    progress_.message(fmt::format("warning: the checkpoint is not kept: {}; the solve goes on", error.what()));
  }
}

void CheckpointFile::remove() {
  std::error_code ignored;
  std::filesystem::remove(use_.file, ignored);
  use_.removed = true;
}

nlohmann::ordered_json checkpoint_json(const std::optional<CheckpointUse>& use) {
  if (!use) return nullptr;
  return {{"file", use->file},
          {"iterations_before", use->iterations},
          {"products_before", use->products},
          {"removed", use->removed}};
}

std::string checkpoint_text(const std::optional<CheckpointUse>& use) {
  if (!use) return "";
  const std::string from = use->iterations == 0 ? std::string("none was there")
                                                : fmt::format("gone on from after {} iterations", use->iterations);
  return fmt::format("checkpoint     {}: {}, {}\n", use->file, from,
                     use->removed ? "removed: the solve is done" : "kept for the next run");
}

}  // namespace interflect::cli
