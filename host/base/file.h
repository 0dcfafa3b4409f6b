#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace interflect {

/// The whole content of a regular file. Throws an input Error when it cannot be opened or read, is a folder, a
/// pipe or a device (never waits for one), or is larger than `limit` bytes (the default bounds what a reader will ever
/// be asked to parse).
[[nodiscard]] std::string read_file(const std::filesystem::path& path, std::uintmax_t limit = std::uintmax_t{1} << 32);

/// A file that appears whole under its final name or not at all: written under a temporary name in the same folder,
/// synced and renamed by commit(), removed by the destructor when commit() was not reached.
class AtomicFile {
 public:
  /// Opens the temporary file. A path that is a symbolic link stands for its target. Throws an input Error when the
  /// folder is missing or not writable, and when the path is there but is a folder, a pipe, a device or
  /// write-protected.
  explicit AtomicFile(std::filesystem::path path);
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  ~AtomicFile();

  /// Appends bytes. Throws an input Error naming the final path when the disk is full or the write fails.
  void write(std::span<const std::byte> bytes);
  void write(std::string_view text) { write(std::as_bytes(std::span(text.data(), text.size()))); }
  /// The temporary name, for libraries that insist on writing the file themselves.
  [[nodiscard]] const std::filesystem::path& temporary() const { return temporary_; }
  /// Flushes to the disk and renames to the final name.
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  int descriptor_ = -1;
  int entry_ = -1;  ///< in the list of temporary files that a signal removes
};

/// From now on SIGINT, SIGTERM and SIGHUP remove the temporary files of this process before they end it. For programs;
/// a library leaves signals alone.
void remove_temporaries_on_signals();

/// While one lives, the first SIGINT or SIGTERM only asks for an end (a line on stderr says what is finished first);
/// the second one ends the process as before. A signal that was ignored stays so. For programs; one at a time.
class PatientInterrupt {
 public:
  static constexpr std::string_view panel_in_hand =
      "interflect: interrupted: finishing the panel in hand (once more to end at once; what is finished is kept)\n";
  /// `line` is what stderr gets, with its newline; a literal, or something else that lives as long.
  explicit PatientInterrupt(std::string_view line = panel_in_hand);
  PatientInterrupt(const PatientInterrupt&) = delete;
  PatientInterrupt& operator=(const PatientInterrupt&) = delete;
  ~PatientInterrupt();
  /// Whether an end was asked for.
  [[nodiscard]] static bool asked() noexcept;
};

/// From now on a file that would grow beyond the process's limit is an error of the write, not a signal that ends the
/// process. For programs.
void file_limit_is_an_error();

}  // namespace interflect
