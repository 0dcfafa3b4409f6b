#include "interflect/device/compile_cache.h"

#include <fmt/format.h>

#include <cstring>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string_view>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/cache_file.h"

namespace interflect {

namespace {

constexpr std::string_view magic = "ifkernel1\n";
constexpr std::uintmax_t largest_entry = std::uintmax_t{256} << 20;

std::mutex statistics_mutex;
CompileStatistics statistics;

std::string text(const CompileKey& key) {
  return joined_key({key.backend, key.device, key.driver, key.options, key.source});
}

std::optional<std::filesystem::path> path_of(const CompileKey& key, const std::string& whole) {
  const auto base = cache_folder("kernels");
  if (!base) return std::nullopt;
  return *base / fmt::format("{}-{:016x}", key.backend, fnv1a(whole));
}

std::optional<std::vector<std::byte>> load(const std::filesystem::path& path, std::string_view key) {
  const auto entry = read_cache_entry(path, magic, largest_entry);
  if (!entry || entry->key != key) return std::nullopt;
  std::vector<std::byte> bytes(entry->content.size());
  std::memcpy(bytes.data(), entry->content.data(), bytes.size());
  return bytes;
}

void store(const std::filesystem::path& path, std::string_view key, const std::vector<std::byte>& binary) {
  try {
    write_cache_entry(path, magic, key, {reinterpret_cast<const char*>(binary.data()), binary.size()});
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
