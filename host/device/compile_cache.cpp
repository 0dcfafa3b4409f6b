#include "interflect/device/compile_cache.h"

#include <fmt/format.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string_view>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/timer.h"

namespace interflect {

namespace {

// An entry: magic, the sizes of key and binary, a checksum over both, the key itself, the binary.
constexpr std::string_view magic = "ifkernel1\n";
constexpr std::uintmax_t largest_entry = std::uintmax_t{256} << 20;

std::mutex statistics_mutex;
CompileStatistics statistics;

/// FNV-1a, 64 bits: names the file and finds damage; the key in the file decides.
std::uint64_t hash(std::string_view bytes) {
  std::uint64_t h = 0xCBF29CE484222325U;
  for (const char c : bytes) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001B3U;
  return h;
}

std::string text(const CompileKey& key) {
  std::string all;
  for (const std::string* part : {&key.backend, &key.device, &key.driver, &key.options, &key.source}) {
    all += fmt::format("{}\n", part->size());
    all += *part;
  }
  return all;
}

std::optional<std::filesystem::path> folder() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string_view(value == nullptr ? "" : value);
  };
  if (variable("INTERFLECT_CACHE") == "off") return std::nullopt;
  std::filesystem::path base = variable("XDG_CACHE_HOME");
  if (!base.is_absolute()) {
    const std::filesystem::path home = variable("HOME");
    if (!home.is_absolute()) return std::nullopt;
    base = home / ".cache";
  }
  return base / "interflect" / "kernels";
}

std::optional<std::filesystem::path> path_of(const CompileKey& key, const std::string& whole) {
  const auto base = folder();
  if (!base) return std::nullopt;
  return *base / fmt::format("{}-{:016x}", key.backend, hash(whole));
}

std::string header(std::string_view key, std::string_view binary) {
  return fmt::format("{}{} {} {:016x}\n", magic, key.size(), binary.size(),
                     hash(key) ^ hash(binary) * 0x9E3779B97F4A7C15U);
}

std::optional<std::vector<std::byte>> load(const std::filesystem::path& path, std::string_view key) {
  std::string content;
  try {
    content = read_file(path, largest_entry);
  } catch (const Error&) {
    return std::nullopt;
  }
  const std::string_view all = content;
  const std::size_t first_line = magic.size();
  if (!all.starts_with(magic)) return std::nullopt;
  const std::size_t end = all.find('\n', first_line);
  if (end == std::string_view::npos || all.size() - end - 1 < key.size()) return std::nullopt;
  const std::string_view rest = all.substr(end + 1);
  const std::string_view binary = rest.substr(key.size());
  if (rest.substr(0, key.size()) != key || all.substr(0, end + 1) != header(key, binary)) return std::nullopt;
  std::vector<std::byte> bytes(binary.size());
  std::memcpy(bytes.data(), binary.data(), binary.size());
  return bytes;
}

void store(const std::filesystem::path& path, std::string_view key, const std::vector<std::byte>& binary) {
  try {
    std::error_code ignored;
    std::filesystem::create_directories(path.parent_path(), ignored);
    const std::string_view content(reinterpret_cast<const char*>(binary.data()), binary.size());
    AtomicFile file(path);
    file.write(header(key, content));
    file.write(key);
    file.write(content);
    file.commit();
  } catch (const Error&) {  // a full or read-only disk: compile again next time
  }
}

}  // namespace

std::vector<std::byte> cached_compile(const CompileKey& key, const std::function<std::vector<std::byte>()>& compile) {
  const Timer timer;
  const std::string whole = text(key);
  const auto path = path_of(key, whole);
  auto binary = path ? load(*path, whole) : std::nullopt;
  const bool hit = binary.has_value();
  if (!hit) {
    binary = compile();
    if (path) store(*path, whole, *binary);
  }
  const std::lock_guard lock(statistics_mutex);
  ++(hit ? statistics.from_cache : statistics.compiled);
  statistics.seconds += timer.seconds();
  return std::move(*binary);
}

void forget_compiled(const CompileKey& key) {
  std::error_code ignored;
  if (const auto path = path_of(key, text(key))) std::filesystem::remove(*path, ignored);
}

CompileStatistics compile_statistics() {
  const std::lock_guard lock(statistics_mutex);
  return statistics;
}

void add_compile_seconds(double seconds) {
  const std::lock_guard lock(statistics_mutex);
  statistics.seconds += seconds;
}

}  // namespace interflect
