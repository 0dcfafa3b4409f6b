#pragma once

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

// Files that save work and may be lost at any time: compiled kernels, tuned launch shapes. An entry holds its whole key
// and a checksum; one that is damaged, or another key's, is as good as none.

namespace interflect {

/// FNV-1a, 64 bits: names files and finds damage; the key in a file decides.
[[nodiscard]] std::uint64_t fnv1a(std::string_view bytes);

/// $XDG_CACHE_HOME/interflect/NAME, else ~/.cache/interflect/NAME. Null where neither is there or INTERFLECT_CACHE is
/// "off".
[[nodiscard]] std::optional<std::filesystem::path> cache_folder(std::string_view name);

/// Several texts as one that no others give.
[[nodiscard]] std::string joined_key(std::initializer_list<std::string_view> parts);

/// An entry as it lies there.
struct CacheEntry {
  std::string key, content;
};
/// The file's entry of this kind (`magic` ends in a newline), or null when it is missing or damaged.
[[nodiscard]] std::optional<CacheEntry> read_cache_entry(const std::filesystem::path& path, std::string_view magic,
                                                         std::uintmax_t most_bytes);
/// Writes it under a temporary name and renames it, in a folder that is made if need be. Throws an input Error.
void write_cache_entry(const std::filesystem::path& path, std::string_view magic, std::string_view key,
                       std::string_view content);

}  // namespace interflect
