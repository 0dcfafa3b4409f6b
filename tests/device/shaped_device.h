#pragma once

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "device/kernel_folder.h"
#include "interflect/base/error.h"
#include "interflect/device/device.h"
#include "interflect/device/registry.h"

namespace interflect::test {

/// INTERFLECT_KERNEL_DIR with sources that only name the macros: for a ShapedDevice that says it is one of OpenCL.
class ShapeSources {
 public:
  ShapeSources() {
    std::filesystem::create_directories(folder_.path() / "cl");
    write("matvec", "ROWS");
    write("tiles16", "STRIPS");
    write("sym16", "BLOCK");
  }
  void write(const std::string& file, const std::string& text) const { std::ofstream(path(file)) << text; }
  [[nodiscard]] std::filesystem::path path(const std::string& file) const {
    return folder_.path() / "cl" / (file + ".cl");
  }

 private:
  TemporaryFolder folder_{"shapes"};
  Variable variable_{"INTERFLECT_KERNEL_DIR", folder_.path().string()};
};

/// What a ShapedDevice pretends to be, and what it has seen.
struct Shaping {
  std::function<void(DeviceInfo&)> describe;
  /// Seconds that a launch of such a kernel takes on `clock`, which nothing else moves.
  std::function<double(const std::string& kernel, const Macros&)> cost = [](const auto&, const auto&) { return 1.0; };
  /// A launch of such a kernel does nothing.
  std::function<bool(const std::string& kernel, const Macros&)> idle = [](const auto&, const auto&) { return false; };
  /// Such a kernel does not compile.
  std::function<bool(const std::string& kernel, const Macros&)> refused = idle;
  double clock = 0;
  std::map<std::string, Macros> macros;         ///< of the kernel of that name that was made last
  std::map<std::string, std::uint32_t> groups;  ///< of its last launch
  std::map<std::string, std::uint64_t> launches;
};

/// An OpenMP device under another name, whose kernels take made-up times and may be wrong in some shapes. Its kernels
/// ignore ROWS and STRIPS, but their launches are checked against them.
class ShapedDevice final : public Device {
 public:
  explicit ShapedDevice(std::shared_ptr<Shaping> shaping)
      : shaping_(std::move(shaping)), inner_(open_device("openmp")), info_(inner_->info()), queue_(*this) {
    if (shaping_->describe) shaping_->describe(info_);
  }
  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override { return inner_->allocate(bytes); }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return inner_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    if (shaping_->refused(std::string(name), macros)) throw device_error(info_.id, "kernel", "too many registers");
    auto made = inner_->kernel(name, macros);
    shaping_->macros[std::string(name)] = macros;
    made_[made.get()] = macros;
    return made;
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  class ShapedQueue final : public Queue {
   public:
    explicit ShapedQueue(ShapedDevice& device) : device_(device) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      inner().upload(to, offset, from);
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      inner().download(from, offset, to);
    }
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      Shaping& shaping = *device_.shaping_;
      const Macros& macros = device_.made_.at(&kernel);
      shaping.clock += shaping.cost(kernel.name(), macros);
      shaping.groups[kernel.name()] = groups;
      ++shaping.launches[kernel.name()];
      if (!shaping.idle(kernel.name(), macros)) inner().launch(kernel, groups, buffers, arguments, label);
    }
    void wait() override { inner().wait(); }

   private:
    Queue& inner() { return device_.inner_->queue(); }
    ShapedDevice& device_;
  };

  std::shared_ptr<Shaping> shaping_;
  std::unique_ptr<Device> inner_;
  DeviceInfo info_;
  ShapedQueue queue_;
  std::map<const Kernel*, Macros> made_;
};

}  // namespace interflect::test
