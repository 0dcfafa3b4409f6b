#include "interflect/device/openmp/openmp.h"

#include <fmt/format.h>
#include <omp.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <fstream>
#include <string>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/openmp/simd.h"
#include "omp/table.h"

namespace interflect::openmp {

namespace {

constexpr std::string_view device_id = "openmp";

// Device-side classes, in the order of device.h: Buffer, Kernel, Queue, Device.

class Buffer final : public interflect::Buffer {
 public:
  /// Memory of its own, zero-filled: huge pages for a matrix, whole cache lines for a vector.
  explicit Buffer(std::size_t bytes) : interflect::Buffer(bytes) {
    if (bytes < std::size_t{1} << 20) {
      lines_.resize((bytes + sizeof(Line) - 1) / sizeof(Line));
      data_ = reinterpret_cast<std::byte*>(lines_.data());
    } else {
      pages_ = std::make_shared<PageBuffer>(bytes);
      data_ = pages_->data();
    }
  }
  /// Host memory in place; only read.
  explicit Buffer(std::shared_ptr<const PageBuffer> memory)
      : interflect::Buffer(memory->size(), true), pages_(std::move(memory)), data_(pages_->data()) {}

  [[nodiscard]] std::span<std::byte> bytes() const { return {data_, size()}; }

 private:
  struct alignas(64) Line {
    std::byte bytes[64] = {};
  };
  std::vector<Line> lines_;
  std::shared_ptr<const PageBuffer> pages_;
  std::byte* data_ = nullptr;
};

class Kernel final : public interflect::Kernel {
 public:
  Kernel(FoundKernel found, omp::Function function)
      : interflect::Kernel(std::string(found.line->name)), found_(std::move(found)), function_(function) {}

  [[nodiscard]] const KernelLine& line() const { return *found_.line; }
  [[nodiscard]] const Macros& macros() const { return found_.macros; }
  [[nodiscard]] omp::Function function() const { return function_; }

 private:
  FoundKernel found_;
  omp::Function function_;
};

class Queue final : public interflect::Queue {
 public:
  explicit Queue(const DeviceInfo& info) : info_(info) {}

  void upload(interflect::Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
    auto& buffer = own<Buffer>(to, info_.id, "upload");
    check_range(info_.id, to, offset, from.size(), "upload");
    if (!from.empty()) std::memcpy(buffer.bytes().data() + offset, from.data(), from.size());
  }

  void download(const interflect::Buffer& from, std::size_t offset, std::span<std::byte> to) override {
    const auto& buffer = own<const Buffer>(from, info_.id, "download");
    check_range(info_.id, from, offset, to.size(), "download");
    if (!to.empty()) std::memcpy(to.data(), buffer.bytes().data() + offset, to.size());
  }

  void launch(const interflect::Kernel& kernel, std::uint32_t groups, std::span<interflect::Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override {
    const auto& mine = own<const Kernel>(kernel, info_.id, "launch");
    check_launch(info_, mine.line(), mine.macros(), groups, buffers, arguments, label);
    std::array<std::span<std::byte>, 8> spans;  // no kernel takes more
    for (std::size_t i = 0; i < buffers.size(); ++i) {
      spans[i] = own<const Buffer>(*buffers[i], info_.id, "launch").bytes();
    }
    omp::Launch call{{groups, arguments, &mine.macros()}, std::span(spans).first(buffers.size())};
    mine.function()(call);
  }

  void wait() override {}  // launches have run when they return

 private:
  const DeviceInfo& info_;
};

class Device final : public interflect::Device {
 public:
  explicit Device(DeviceInfo info) : info_(std::move(info)), queue_(info_) {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> allocate(std::size_t bytes) override {
    try {
      return std::make_unique<Buffer>(bytes);
    } catch (const Error& error) {
      refuse(info_.id, fmt::format("allocate {} bytes", bytes), error.what());
    }
  }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    if (memory == nullptr) refuse(info_.id, "share", "no memory given");
    return std::make_unique<Buffer>(std::move(memory));
  }

  [[nodiscard]] std::unique_ptr<interflect::Kernel> kernel(std::string_view name, const Macros& macros) override {
    FoundKernel found = find_kernel(info_.id, name, macros);
    const omp::Function function = omp::find_function(name);
    if (function == nullptr) refuse(info_.id, fmt::format("kernel {}", name), "this backend has no such kernel");
    return std::make_unique<Kernel>(std::move(found), function);
  }

  [[nodiscard]] interflect::Queue& queue() override { return queue_; }

 private:
  DeviceInfo info_;
  Queue queue_;
};

std::string processor_name() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    const std::size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "CPU";
}

std::string driver() {
#if defined(__clang__)
  constexpr std::string_view compiler = "Clang " __clang_version__;
#else
  constexpr std::string_view compiler = "GCC " __VERSION__;
#endif
  constexpr std::string_view version = _OPENMP >= 202011 ? "5.1" : _OPENMP >= 201811 ? "5.0" : "4.5";
  return fmt::format("OpenMP {} ({}), Highway {}", version, compiler, simd_target());
}

DeviceInfo describe() {
  const std::uint64_t memory =
      static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return {
      .id = std::string(device_id),
      .backend = "openmp",
      .name = processor_name(),
      .driver = driver(),
      .type = DeviceType::cpu,
      .memory_bytes = memory,
      .max_buffer_bytes = memory,
      .compute_units = static_cast<std::uint32_t>(::omp_get_max_threads()),
      .hardware = {},
      // A work-group is a thread's share: below some 16,000 elements waking a second thread costs more than it saves.
      .blocks_per_group = 16};
}

}  // namespace

std::vector<DeviceEntry> list_devices() {
  return {{.info = describe(), .available = true, .reason = ""}};
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t /*index*/) {
  return std::make_unique<Device>(describe());
}

}  // namespace interflect::openmp
