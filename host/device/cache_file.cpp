#include "interflect/device/cache_file.h"

#include <fmt/format.h>

#include <cstdlib>

#include "interflect/base/error.h"
#include "interflect/base/file.h"

namespace interflect {

namespace {

// An entry: magic, the sizes of key and content with a checksum over both, the key itself, the content.
std::string header(std::string_view magic, std::string_view key, std::string_view content) {
  return fmt::format("{}{} {} {:016x}\n", magic, key.size(), content.size(),
                     fnv1a(key) ^ fnv1a(content) * 0x9E3779B97F4A7C15U);
}

/// The number at the head of a text, which loses it and the space behind it; 0 for none.
std::size_t take_number(std::string_view& text) {
  std::size_t value = 0, digits = 0;
  for (; digits < text.size() && digits < 15 && text[digits] >= '0' && text[digits] <= '9'; ++digits) {
    value = 10 * value + static_cast<std::size_t>(text[digits] - '0');
  }
  text.remove_prefix(digits < text.size() ? digits + 1 : digits);
  return value;
}

}  // namespace

std::uint64_t fnv1a(std::string_view bytes) {
  std::uint64_t h = 0xCBF29CE484222325U;
  for (const char c : bytes) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001B3U;
  return h;
}

std::string joined_key(std::initializer_list<std::string_view> parts) {
  std::string all;
  for (const std::string_view part : parts) {
    all += fmt::format("{}\n", part.size());
    all += part;
  }
  return all;
}

std::optional<std::filesystem::path> cache_folder(std::string_view name) {
  const auto variable = [](const char* of) {
    const char* value = std::getenv(of);
    return std::string_view(value == nullptr ? "" : value);
  };
  if (variable("INTERFLECT_CACHE") == "off") return std::nullopt;
  std::filesystem::path base = variable("XDG_CACHE_HOME");
  if (!base.is_absolute()) {
    const std::filesystem::path home = variable("HOME");
    if (!home.is_absolute()) return std::nullopt;
    base = home / ".cache";
  }
  return base / "interflect" / name;
}

std::optional<CacheEntry> read_cache_entry(const std::filesystem::path& path, std::string_view magic,
                                           std::uintmax_t most_bytes) {
  std::string file;
  try {
    file = read_file(path, most_bytes);
  } catch (const Error&) {
    return std::nullopt;
  }
  const std::string_view all = file;
  if (!all.starts_with(magic)) return std::nullopt;
  const std::size_t end = all.find('\n', magic.size());
  if (end == std::string_view::npos) return std::nullopt;
  std::string_view sizes = all.substr(magic.size(), end - magic.size());
  const std::string_view rest = all.substr(end + 1);
  const std::size_t key_size = take_number(sizes);
  if (key_size > rest.size()) return std::nullopt;
  CacheEntry entry{std::string(rest.substr(0, key_size)), std::string(rest.substr(key_size))};
  if (all.substr(0, end + 1) != header(magic, entry.key, entry.content)) return std::nullopt;
  return entry;
}

void write_cache_entry(const std::filesystem::path& path, std::string_view magic, std::string_view key,
                       std::string_view content) {
  std::error_code ignored;
  std::filesystem::create_directories(path.parent_path(), ignored);
  AtomicFile file(path);
  file.write(header(magic, key, content));
  file.write(key);
  file.write(content);
  file.commit();
}

}  // namespace interflect
