#include "interflect/formfactor/descriptor.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace interflect {

Descriptor::~Descriptor() {
  if (value_ >= 0) ::close(value_);
}

Error file_error(const std::string& name, const char* action, int error) {
  const std::string line = input_error(name, 0, fmt::format("cannot {}: {}", action, std::strerror(error))).what();
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return {full ? ErrorKind::limit : ErrorKind::input, line};
}

std::uint64_t size_of(const Descriptor& file, const std::string& name) {
  struct stat status {};
  if (::fstat(file.get(), &status) != 0) throw file_error(name, "stat", errno);
  if (S_ISDIR(status.st_mode)) throw input_error(name, 0, "is a folder, not a file");
  if (!S_ISREG(status.st_mode)) throw input_error(name, 0, "is a pipe or a device, not a regular file");
  return static_cast<std::uint64_t>(status.st_size);
}

bool read_at(const Descriptor& file, const std::string& name, std::uint64_t offset, std::span<std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t got = ::pread(file.get(), bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw file_error(name, "read", errno);
    if (got == 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
  return true;
}

void write_at(const Descriptor& file, const std::string& name, std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t put = ::pwrite(file.get(), bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) throw file_error(name, "write", errno);
    bytes = bytes.subspan(static_cast<std::size_t>(put));
    offset += static_cast<std::uint64_t>(put);
  }
}

}  // namespace interflect
