#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

/// Owns an open file.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int value) : value_(value) {}
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor();
  [[nodiscard]] int get() const { return value_; }
  explicit operator bool() const { return value_ >= 0; }

 private:
  int value_ = -1;
};

/// "NAME: cannot ACTION: why" from errno: a limit Error where the disk, a quota or a file's largest size is full, else
/// an input Error.
[[nodiscard]] Error file_error(const std::string& name, const char* action, int error);

/// Bytes of the file, if it is a regular one. Throws an input Error otherwise.
[[nodiscard]] std::uint64_t size_of(const Descriptor& file, const std::string& name);

/// Fills `bytes` from that place. False when the file ends before. Throws file_error().
[[nodiscard]] bool read_at(const Descriptor& file, const std::string& name, std::uint64_t offset,
                           std::span<std::byte> bytes);
/// Writes all bytes at that place. Throws file_error().
void write_at(const Descriptor& file, const std::string& name, std::uint64_t offset, std::span<const std::byte> bytes);

}  // namespace interflect
