#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "interflect/base/memory.h"

namespace interflect {

enum class DeviceType { cpu, gpu, other };

/// What is known of a device without running anything on it.
struct DeviceInfo {
  std::string id;       ///< "backend:index", or "openmp"
  std::string backend;  ///< openmp, opencl, vulkan, cuda
  std::string name;     ///< the hardware's name as its driver gives it
  std::string driver;   ///< driver and its version
  DeviceType type = DeviceType::other;
  std::uint64_t memory_bytes = 0;
  std::uint64_t max_buffer_bytes = 0;  ///< the largest buffer that a kernel can be given
  std::uint32_t compute_units = 0;
  std::uint32_t max_clock_mhz = 0;  ///< as the API says; 0: not known
  std::string hardware;  ///< the same text for one piece of hardware seen through several drivers; empty: not known
  std::uint32_t max_groups = 0xFFFFFFFF;  ///< work-groups of one launch
  // Launch shapes that suit the device. No result depends on the second, rounding may on the first.
  std::uint32_t rows_per_group = 16;   ///< macro ROWS of matvec: rows of F for one work-group
  std::uint32_t blocks_per_group = 1;  ///< of the vector kernels

  /// A driver that runs GPU kernels on the processor: for tests and comparison, never chosen unless it is named.
  [[nodiscard]] bool emulated() const { return type == DeviceType::cpu && backend != "openmp"; }
};

/// Memory on a device; its destructor frees it. Knows its size; contents go through the Queue.
class Buffer {
 public:
  explicit Buffer(std::size_t bytes, bool read_only = false) : size_(bytes), read_only_(read_only) {}
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  virtual ~Buffer() = default;
  [[nodiscard]] std::size_t size() const { return size_; }
  /// Made by share(): kernels may read it, nothing may write it.
  [[nodiscard]] bool read_only() const { return read_only_; }

 private:
  std::size_t size_;
  bool read_only_;
};

/// A compiled entry point of kernels/.
class Kernel {
 public:
  explicit Kernel(std::string name) : name_(std::move(name)) {}
  Kernel(const Kernel&) = delete;
  Kernel& operator=(const Kernel&) = delete;
  virtual ~Kernel() = default;
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  std::string name_;
};

/// Compile-time parameters of a kernel, the same names in every language: TILE, ROWS, WORKGROUP, COLUMNS, ...
using Macros = std::map<std::string, int>;

/// Work in order: what is enqueued later sees the results of what was enqueued before. Errors are DeviceErrors
/// (ErrorKind::device) naming device, operation and cause.
class Queue {
 public:
  Queue() = default;
  Queue(const Queue&) = delete;
  Queue& operator=(const Queue&) = delete;
  virtual ~Queue() = default;

  /// Host to buffer; the bytes may be reused on return. offset + size is checked against the buffer.
  virtual void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) = 0;
  /// Buffer to host, after everything enqueued before; the bytes are there on return.
  virtual void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) = 0;
  /// Runs `groups` work-groups of the kernel over its buffers, in the order that kernels/README.md gives, with its
  /// plain-old-data argument block. `label` names the launch for profilers and errors.
  virtual void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                      std::span<const std::byte> arguments, std::string_view label) = 0;
  /// Returns when everything enqueued is done.
  virtual void wait() = 0;
};

/// One opened accelerator. Makes buffers and kernels and owns its queue. Never stands in for another device silently.
class Device {
 public:
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  virtual ~Device() = default;

  [[nodiscard]] virtual const DeviceInfo& info() const = 0;
  /// Zero-filled memory. Throws a device Error when the device refuses.
  [[nodiscard]] virtual std::unique_ptr<Buffer> allocate(std::size_t bytes) = 0;
  /// A buffer over host memory that the device uses in place and only reads; null where the device cannot (then
  /// allocate() and upload()).
  [[nodiscard]] virtual std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) = 0;
  /// The entry point `name` of kernels/, compiled with the macros. Throws a device Error for an unknown name or macro
  /// value.
  [[nodiscard]] virtual std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) = 0;
  [[nodiscard]] virtual Queue& queue() = 0;
};

}  // namespace interflect
