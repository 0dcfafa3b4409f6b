#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace interflect {

/// Bytes that this process may still use: the smaller of the machine's available memory and the control group's limit.
/// INTERFLECT_MEMORY (bytes, or with a suffix K, M, G) overrides it, so that a limit can be tested.
[[nodiscard]] std::uint64_t available_memory();

/// "4G", "500M", "1.5g", "64K", or bytes. Throws a usage Error that begins with `name` for another text.
[[nodiscard]] std::uint64_t parse_bytes(const std::string& text, std::string_view name);

/// Zero-filled memory for a matrix: 2 MiB-aligned, huge pages requested, pages touched first by whoever writes them.
class PageBuffer {
 public:
  PageBuffer() = default;
  /// Throws a limit Error when the system refuses.
  explicit PageBuffer(std::size_t bytes);
  /// Some of the bytes of another one, in place; the whole lives as long. Throws an internal Error for bytes that it
  /// has not.
  [[nodiscard]] static std::shared_ptr<const PageBuffer> part(std::shared_ptr<const PageBuffer> whole,
                                                              std::size_t offset, std::size_t bytes);
  [[nodiscard]] std::byte* data() const { return data_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  struct Unmap {
    Unmap() noexcept : mapped(0) {}
    explicit Unmap(std::size_t bytes) noexcept : mapped(bytes) {}
    std::size_t mapped;
    void operator()(std::byte* p) const noexcept;
  };
  std::unique_ptr<std::byte, Unmap> data_;
  std::size_t size_ = 0;
  std::shared_ptr<const PageBuffer> whole_;  ///< of a part
};

}  // namespace interflect
