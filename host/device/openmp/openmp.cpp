#include "interflect/device/openmp/openmp.h"

#include <fmt/format.h>
#include <omp.h>
#include <unistd.h>

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
      : interflect::Buffer(memory->size()), pages_(std::move(memory)), data_(pages_->data()), shared_(true) {}

  [[nodiscard]] std::span<std::byte> bytes() const { return {data_, size()}; }
  [[nodiscard]] bool shared() const { return shared_; }

 private:
  struct alignas(64) Line {
    std::byte bytes[64] = {};
  };
  std::vector<Line> lines_;
  std::shared_ptr<const PageBuffer> pages_;
  std::byte* data_ = nullptr;
  bool shared_ = false;
};

class Kernel final : public interflect::Kernel {
 public:
  Kernel(const omp::TableLine& line, Macros macros)
      : interflect::Kernel(std::string(line.name)), line_(line), macros_(std::move(macros)) {}

  [[nodiscard]] const omp::TableLine& line() const { return line_; }
  [[nodiscard]] const Macros& macros() const { return macros_; }

 private:
  const omp::TableLine& line_;
  Macros macros_;
};

/// The object as this backend's own class, or an Error when it was made by another device.
template <class Own, class Interface>
Own& own(Interface& object, std::string_view operation) {
  auto* mine = dynamic_cast<Own*>(&object);
  if (mine == nullptr) throw device_error(device_id, operation, "a buffer or kernel of another device");
  return *mine;
}

void check_range(const interflect::Buffer& buffer, std::size_t offset, std::size_t bytes, std::string_view operation) {
  if (offset <= buffer.size() && bytes <= buffer.size() - offset) return;
  throw device_error(device_id, operation,
                     fmt::format("bytes {} to {} of a buffer of {}", offset, offset + bytes, buffer.size()));
}

class Queue final : public interflect::Queue {
 public:
  void upload(interflect::Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
    auto& buffer = own<Buffer>(to, "upload");
    check_range(to, offset, from.size(), "upload");
    if (buffer.shared()) throw device_error(device_id, "upload", "the buffer shares memory of the host, read only");
    if (!from.empty()) std::memcpy(buffer.bytes().data() + offset, from.data(), from.size());
  }

  void download(const interflect::Buffer& from, std::size_t offset, std::span<std::byte> to) override {
    const auto& buffer = own<const Buffer>(from, "download");
    check_range(from, offset, to.size(), "download");
    if (!to.empty()) std::memcpy(to.data(), buffer.bytes().data() + offset, to.size());
  }

  void launch(const interflect::Kernel& kernel, std::uint32_t groups, std::span<interflect::Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override {
    const std::string operation = fmt::format("launch {} ({})", kernel.name(), label);
    const auto refuse = [&](std::string_view cause) { throw device_error(device_id, operation, cause); };
    const auto& mine = own<const Kernel>(kernel, operation);
    const omp::TableLine& line = mine.line();
    if (buffers.size() != line.access.size()) {
      refuse(fmt::format("{} buffers given, {} needed", buffers.size(), line.access.size()));
    }
    if (arguments.size() != line.argument_bytes) {
      refuse(fmt::format("an argument block of {} bytes given, {} needed", arguments.size(), line.argument_bytes));
    }
    std::vector<std::span<std::byte>> spans;
    spans.reserve(buffers.size());
    for (std::size_t i = 0; i < buffers.size(); ++i) {
      if (buffers[i] == nullptr) refuse(fmt::format("buffer {} is missing", i));
      const auto& buffer = own<const Buffer>(*buffers[i], operation);
      if (line.access[i] != 'r' && buffer.shared()) {
        refuse(fmt::format("buffer {} is written, but shares memory of the host, read only", i));
      }
      spans.push_back(buffer.bytes());
    }
    try {
      line.run({groups, spans, arguments, &mine.macros()});
    } catch (const omp::KernelRefusal& refusal) {
      refuse(refusal.cause);
    }
  }

  void wait() override {}  // launches have run when they return
};

class Device final : public interflect::Device {
 public:
  explicit Device(DeviceInfo info) : info_(std::move(info)) {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> allocate(std::size_t bytes) override {
    try {
      return std::make_unique<Buffer>(bytes);
    } catch (const Error& error) {
      throw device_error(device_id, fmt::format("allocate {} bytes", bytes), error.what());
    }
  }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    if (memory == nullptr) throw device_error(device_id, "share", "no memory given");
    return std::make_unique<Buffer>(std::move(memory));
  }

  [[nodiscard]] std::unique_ptr<interflect::Kernel> kernel(std::string_view name, const Macros& macros) override {
    const std::string operation = fmt::format("kernel {}", name);
    for (const omp::TableLine& line : omp::kernel_table()) {
      if (line.name != name) continue;
      check_macros(line, macros, operation);
      return std::make_unique<Kernel>(line, macros);
    }
    throw device_error(device_id, operation, "unknown kernel");
  }

  [[nodiscard]] interflect::Queue& queue() override { return queue_; }

 private:
  /// Every macro of the line is given with a value in its range. Others are for other backends and ignored.
  static void check_macros(const omp::TableLine& line, const Macros& macros, std::string_view operation) {
    for (const omp::MacroRange& range : line.macros) {
      const auto given = macros.find(std::string(range.name));
      if (given == macros.end()) {
        throw device_error(device_id, operation, fmt::format("macro {} is not given", range.name));
      }
      if (given->second < range.smallest || given->second > range.largest) {
        throw device_error(device_id, operation,
                           fmt::format("macro {} is {}, it must be {} to {}", range.name, given->second, range.smallest,
                                       range.largest));
      }
    }
  }

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
  return {.id = std::string(device_id),
          .backend = "openmp",
          .name = processor_name(),
          .driver = driver(),
          .type = DeviceType::cpu,
          .memory_bytes = memory,
          .max_buffer_bytes = memory,
          .compute_units = static_cast<std::uint32_t>(::omp_get_max_threads())};
}

}  // namespace

std::vector<DeviceEntry> list_devices() {
  return {{.info = describe(), .available = true, .reason = ""}};
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t /*index*/) {
  return std::make_unique<Device>(describe());
}

}  // namespace interflect::openmp
