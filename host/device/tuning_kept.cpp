#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/device/cache_file.h"
#include "interflect/device/embedded_kernels.h"
#include "interflect/device/kernel_source.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/tuning.h"

// Tuned launch shapes on disk, and what they mean to those who launch.

namespace interflect {

namespace {

constexpr std::string_view magic = "iftuning1\n";
constexpr std::uintmax_t largest_entry = 1 << 16;

std::string_view variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

const KernelLine* line_of(std::string_view kernel) {
  for (const KernelLine& line : kernel_table()) {
    if (line.name == kernel) return &line;
  }
  return nullptr;
}

/// The source of the kernel's file for a GPU backend. Throws a device Error when it is missing.
std::string source_of(const DeviceInfo& device, std::string_view file) {
  if (device.backend == "opencl") return kernel_source("cl", fmt::format("{}.cl", file));
  if (device.backend == "vulkan") return kernel_source("glsl", fmt::format("{}.comp", file));
  return kernel_source("cuda", fmt::format("{}.cu", file));
}

/// Device, driver, all that decides how the backend cuts its kernels, and the kernel as it is in this build.
std::string key_of(const DeviceInfo& device, const KernelLine& line) {
  const std::string source =
      device.backend == "openmp" ? std::string(openmp_kernels_hash()) : source_of(device, line.file);
  const std::string shape =
      fmt::format("{} units, {} rows, {} blocks, {} groups, {} {} {}", device.compute_units, device.rows_per_group,
                  device.blocks_per_group, device.max_groups, variable("INTERFLECT_OPENCL_SHAPE"),
                  variable("INTERFLECT_VULKAN_SHAPE"), variable("INTERFLECT_VULKAN_SUBGROUP"));
  return joined_key({device.backend, device.name, device.driver, line.name, shape,
                     fmt::format("{:016x}", fnv1a(source)), std::to_string(tuned_columns)});
}

std::optional<std::filesystem::path> path_of(const DeviceInfo& device, const KernelLine& line, const std::string& key) {
  const auto folder = cache_folder("tuning");
  if (!folder) return std::nullopt;
  return *folder / fmt::format("{}-{}-{:016x}", device.backend, line.name, fnv1a(key));
}

/// "gain done", then "MACRO default chosen" for each, a line each.
std::string content_of(const TunedShape& shape) {
  std::string out = fmt::format("{:.4f} {}\n", shape.gain, shape.done ? 1 : 0);
  for (const auto& [name, value] : shape.chosen) {
    out += fmt::format("{} {} {}\n", name, shape.standard.at(name), value);
  }
  return out;
}

/// The text up to the next `end`, which are both taken away; null without one.
std::optional<std::string_view> take(std::string_view& text, char end) {
  const std::size_t at = text.find(end);
  if (at == std::string_view::npos) return std::nullopt;
  const std::string_view part = text.substr(0, at);
  text.remove_prefix(at + 1);
  return part;
}

template <class Number>
std::optional<Number> take_number(std::string_view& text, char end) {
  const auto part = take(text, end);
  if (!part) return std::nullopt;
  Number value{};
  const auto [next, status] = std::from_chars(part->data(), part->data() + part->size(), value);
  if (status != std::errc{} || next != part->data() + part->size()) return std::nullopt;
  return value;
}

/// A shape as content_of() wrote it, whatever its values; null when it is not one.
std::optional<TunedShape> shape_from(std::string_view kernel, std::string_view text) {
  TunedShape shape;
  shape.kernel = kernel;
  const auto gain = take_number<double>(text, ' ');
  const auto done = take_number<int>(text, '\n');
  if (!gain || !done || !std::isfinite(*gain)) return std::nullopt;
  shape.gain = *gain;
  shape.done = *done != 0;
  while (!text.empty()) {
    const auto name = take(text, ' ');
    const auto standard = take_number<int>(text, ' ');
    const auto chosen = take_number<int>(text, '\n');
    if (!name || !standard || !chosen) return std::nullopt;
    shape.standard.insert_or_assign(std::string(*name), *standard);
    shape.chosen.insert_or_assign(std::string(*name), *chosen);
  }
  return shape;
}

/// Only what a search could have found: the macros that can be tuned, each with one of its candidates.
bool plausible(const DeviceInfo& device, const TunedShape& shape) {
  const std::vector<TunableMacro> macros = tunable_macros(device, shape.kernel);
  if (shape.chosen.size() != macros.size()) return false;
  return std::all_of(macros.begin(), macros.end(), [&](const TunableMacro& macro) {
    const auto found = shape.chosen.find(macro.name);
    return found != shape.chosen.end() && shape.standard.at(macro.name) == macro.standard &&
           std::find(macro.values.begin(), macro.values.end(), found->second) != macro.values.end();
  });
}

/// The parts of joined_key().
std::vector<std::string> parts_of(std::string_view key) {
  std::vector<std::string> parts;
  while (!key.empty()) {
    const auto size = take_number<std::size_t>(key, '\n');
    if (!size || *size > key.size()) return {};
    parts.emplace_back(key.substr(0, *size));
    key.remove_prefix(*size);
  }
  return parts;
}

std::vector<std::filesystem::path> files_kept() {
  std::vector<std::filesystem::path> files;
  const auto folder = cache_folder("tuning");
  if (!folder) return files;
  std::error_code missing;
  for (std::filesystem::directory_iterator at(*folder, missing), end; at != end; at.increment(missing)) {
    files.push_back(at->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::optional<KeptShape> read_kept(const std::filesystem::path& file) {
  const auto entry = read_cache_entry(file, magic, largest_entry);
  if (!entry) return std::nullopt;
  const std::vector<std::string> parts = parts_of(entry->key);
  if (parts.size() != 7) return std::nullopt;
  auto shape = shape_from(parts[3], entry->content);
  if (!shape) return std::nullopt;
  return KeptShape{parts[0], parts[1], parts[2], std::move(*shape), file};
}

}  // namespace

bool tuning_allowed() {
  return variable("INTERFLECT_TUNING") != "off";
}

std::vector<TunableMacro> tunable_macros(const DeviceInfo& device, std::string_view kernel) {
  std::vector<TunableMacro> macros;
  const KernelLine* line = line_of(kernel);
  if (line == nullptr) return macros;
  const bool openmp = device.backend == "openmp";
  std::optional<std::string> source;
  const Macros standard = default_macros(device, kernel);
  for (const MacroRange& range : line->macros) {
    if (range.candidates.empty() || (openmp && range.of_groups)) continue;
    if (!openmp && !source) source = source_of(device, line->file);
    if (!openmp && source->find(range.name) == std::string::npos) continue;  // the device's language has no use for it
    const auto given = standard.find(std::string(range.name));
    // BLOCK: on a processor the largest, which is what a large PackedMatrix takes.
    const int untuned =
        device.type == DeviceType::cpu ? range.candidates.back() : static_cast<int>(default_block_of_gpus);
    const int value = given == standard.end() ? untuned : given->second;
    TunableMacro macro{std::string(range.name), range.candidates, value};
    const auto at = std::lower_bound(macro.values.begin(), macro.values.end(), value);
    if (at == macro.values.end() || *at != value) macro.values.insert(at, value);
    macros.push_back(std::move(macro));
  }
  return macros;
}

std::vector<std::string> tunable_kernels(const DeviceInfo& device) {
  std::vector<std::string> kernels;
  for (const KernelLine& line : kernel_table()) {
    try {
      if (!tunable_macros(device, line.name).empty()) kernels.emplace_back(line.name);
    } catch (const Error&) {  // the device's language has no such kernel
    }
  }
  return kernels;
}

std::optional<TunedShape> kept_shape(const DeviceInfo& device, std::string_view kernel) {
  const KernelLine* line = line_of(kernel);
  if (line == nullptr || !tuning_allowed()) return std::nullopt;
  try {
    const std::string key = key_of(device, *line);
    const auto path = path_of(device, *line, key);
    const auto entry = path ? read_cache_entry(*path, magic, largest_entry) : std::nullopt;
    if (!entry || entry->key != key) return std::nullopt;
    auto shape = shape_from(kernel, entry->content);
    if (shape && !plausible(device, *shape)) return std::nullopt;
    return shape;
  } catch (const Error&) {  // a kernel file is missing: whoever compiles it will say so
    return std::nullopt;
  }
}

std::string keep_shape(const DeviceInfo& device, const TunedShape& shape) {
  try {
    const KernelLine* line = line_of(shape.kernel);
    if (line == nullptr) return "unknown kernel";
    const std::string key = key_of(device, *line);
    const auto path = path_of(device, *line, key);
    if (!path) return "there is no cache folder, or INTERFLECT_CACHE is off";
    write_cache_entry(*path, magic, key, content_of(shape));
    return "";
  } catch (const Error& error) {
    return error.what();
  }
}

bool shapes_can_be_kept() {
  const auto folder = cache_folder("tuning");
  if (!folder) return false;
  try {
    std::error_code ignored;
    std::filesystem::create_directories(*folder, ignored);
    const AtomicFile probe(*folder / "probe");
    return true;
  } catch (const Error&) {
    return false;
  }
}

Macros launch_macros(const DeviceInfo& device, std::string_view kernel, std::uint32_t columns) {
  Macros macros = default_macros(device, kernel);
  macros.insert_or_assign("COLUMNS", static_cast<int>(columns));
  if (columns != tuned_columns) return macros;
  if (const auto kept = kept_shape(device, kernel)) {
    for (const auto& [name, value] : kept->chosen) macros.insert_or_assign(name, value);
  }
  macros.erase("BLOCK");
  return macros;
}

std::uint32_t preferred_block(const DeviceInfo* device, std::uint32_t n) {
  if (device == nullptr) return 0;
  const auto kept = kept_shape(*device, "sym16");
  const auto block = kept ? kept->chosen.find("BLOCK") : Macros::const_iterator{};
  if (!kept || block == kept->chosen.end() || block->second == kept->standard.at("BLOCK")) return 0;
  const auto value = static_cast<std::uint32_t>(block->second);
  return n / 8 >= value ? value : 0;
}

std::vector<KeptShape> kept_shapes() {
  std::vector<KeptShape> all;
  for (const std::filesystem::path& file : files_kept()) {
    if (auto kept = read_kept(file)) all.push_back(std::move(*kept));
  }
  return all;
}

std::size_t forget_shapes(const std::vector<DeviceInfo>* devices) {
  std::size_t count = 0;
  for (const std::filesystem::path& file : files_kept()) {
    if (devices != nullptr) {
      const auto kept = read_kept(file);
      const auto is_of = [&](const DeviceInfo& device) { return kept->of(device); };
      if (!kept || std::none_of(devices->begin(), devices->end(), is_of)) continue;
    }
    std::error_code cause;
    if (std::filesystem::remove(file, cause)) ++count;
    if (cause) throw Error(ErrorKind::input, fmt::format("{}: cannot be removed: {}", file.string(), cause.message()));
  }
  return count;
}

}  // namespace interflect
