#include "interflect/base/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

namespace {

/// Owns a descriptor for the length of read_file().
struct Descriptor {
  int value;
  explicit Descriptor(int fd) : value(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (value >= 0) ::close(value);
  }
};

Error system_error(const std::filesystem::path& path, std::string_view action) {
  return input_error(path.string(), 0, fmt::format("cannot {}: {}", action, std::strerror(errno)));
}

}  // namespace

std::string read_file(const std::filesystem::path& path, std::uintmax_t limit) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.value < 0) throw system_error(path, "open");
  struct stat status {};
  if (::fstat(file.value, &status) != 0) throw system_error(path, "stat");
  if (S_ISDIR(status.st_mode)) throw input_error(path.string(), 0, "is a folder, not a file");
  std::string content;
  if (S_ISREG(status.st_mode)) {
    if (static_cast<std::uintmax_t>(status.st_size) > limit) {
      throw input_error(path.string(), 0, fmt::format("is larger than the limit of {} bytes", limit));
    }
    content.reserve(static_cast<std::size_t>(status.st_size));
  }
  std::string chunk(std::size_t{1} << 16, '\0');
  for (;;) {
    const ssize_t got = ::read(file.value, chunk.data(), chunk.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw system_error(path, "read");
    if (got == 0) return content;
    content.append(chunk, 0, static_cast<std::size_t>(got));
    if (content.size() > limit) {
      throw input_error(path.string(), 0, fmt::format("is larger than the limit of {} bytes", limit));
    }
  }
}

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)) {
  if (std::filesystem::is_directory(path_)) throw input_error(path_.string(), 0, "is a folder, not a file");
  std::string name = path_.string() + ".part-XXXXXX";
  descriptor_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (descriptor_ < 0) throw system_error(path_, "create");
  temporary_ = name;
  // mkostemp makes the file private; a result gets the permissions that any new file would have.
  const mode_t mask = ::umask(0);
  ::umask(mask);
  if (::fchmod(descriptor_, 0666 & ~mask) != 0) errno = 0;  // some filesystems have no permissions to change
}

AtomicFile::~AtomicFile() {
  if (descriptor_ < 0) return;
  ::close(descriptor_);
  ::unlink(temporary_.c_str());
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw system_error(path_, "write");
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

void AtomicFile::commit() {
  if (::fsync(descriptor_) != 0 && errno != EINVAL) throw system_error(path_, "write");
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) throw system_error(path_, "rename the finished file");
  ::close(std::exchange(descriptor_, -1));
}

}  // namespace interflect
