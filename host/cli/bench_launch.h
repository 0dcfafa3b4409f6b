#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "interflect/device/device.h"

namespace interflect::cli {

using SharedDevice = std::shared_ptr<Device>;

/// The bytes of a kernel's argument block.
template <class Arguments>
[[nodiscard]] std::vector<std::byte> block_of(const Arguments& arguments) {
  const auto bytes = std::as_bytes(std::span(&arguments, 1));
  return {bytes.begin(), bytes.end()};
}

/// A kernel with its buffers and argument block, ready to be launched again and again.
class Launch {
 public:
  /// Compiles the kernel; throws what the device throws.
  Launch(SharedDevice device, std::string_view kernel, std::vector<std::byte> arguments, std::uint32_t groups,
         std::vector<std::shared_ptr<Buffer>> buffers);

  /// Seconds per launch of `count` that are enqueued together.
  [[nodiscard]] double seconds(int count);
  /// The first floats of a buffer, and floats to its head.
  [[nodiscard]] std::vector<float> floats(std::size_t buffer, std::size_t count);
  void put(std::size_t buffer, std::span<const float> values);

 private:
  SharedDevice device_;
  std::unique_ptr<Kernel> kernel_;
  std::vector<std::byte> arguments_;
  std::uint32_t groups_;
  std::vector<std::shared_ptr<Buffer>> buffers_;
  std::vector<Buffer*> bound_;
};

}  // namespace interflect::cli
