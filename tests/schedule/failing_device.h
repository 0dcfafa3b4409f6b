#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/device/device.h"
#include "interflect/device/registry.h"

namespace interflect::test {

/// When a FailingDevice fails, and what it has seen.
struct Fate {
  enum class Way {
    lost,    ///< the call and every later one throws a device Error
    silent,  ///< the call and every later one that enqueues work does nothing and says nothing
    skips,   ///< only that call does nothing
  };
  std::uint64_t fails_at = std::numeric_limits<std::uint64_t>::max();  ///< the number of the call, from 0
  Way way = Way::lost;
  std::uint64_t calls = 0;
  std::vector<std::string> operations;            ///< of every call
  std::map<std::string, std::uint64_t> launches;  ///< that were done, by kernel
  int live_buffers = 0, live_kernels = 0;
};

/// A device, OpenMP's if no other is given, not sharing memory, that fails at its k-th allocation, kernel, launch,
/// upload, download or wait.
class FailingDevice final : public Device {
 public:
  /// `inner` may be shared by several, one after the other: opening one and compiling its kernels takes longest.
  explicit FailingDevice(std::shared_ptr<Fate> fate, std::shared_ptr<Device> inner = open_device("openmp"),
                         const std::string& id = "failing")
      : fate_(std::move(fate)), inner_(std::move(inner)), info_(inner_->info()), queue_(*this) {
    info_.id = id;
  }

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override {
    static_cast<void>(meets("allocate"));
    return std::make_unique<OwnBuffer>(inner_->allocate(bytes), fate_);
  }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> /*memory*/) override { return nullptr; }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    static_cast<void>(meets("kernel"));
    return std::make_unique<OwnKernel>(inner_->kernel(name, macros), fate_);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  struct OwnBuffer final : Buffer {
    OwnBuffer(std::unique_ptr<Buffer> made, std::shared_ptr<Fate> shared)
        : Buffer(made->size()), inner(std::move(made)), fate(std::move(shared)) {
      ++fate->live_buffers;
    }
    ~OwnBuffer() override { --fate->live_buffers; }
    std::unique_ptr<Buffer> inner;
    std::shared_ptr<Fate> fate;
  };
  struct OwnKernel final : Kernel {
    OwnKernel(std::unique_ptr<Kernel> made, std::shared_ptr<Fate> shared)
        : Kernel(made->name()), inner(std::move(made)), fate(std::move(shared)) {
      ++fate->live_kernels;
    }
    ~OwnKernel() override { --fate->live_kernels; }
    std::unique_ptr<Kernel> inner;
    std::shared_ptr<Fate> fate;
  };

  /// Counts a call. True when it is to be done; throws when the device is lost.
  [[nodiscard]] bool meets(const std::string& operation) {
    const std::uint64_t call = fate_->calls++;
    fate_->operations.push_back(operation);
    if (fate_->way == Fate::Way::skips) return call != fate_->fails_at;
    if (call < fate_->fails_at) return true;
    if (fate_->way == Fate::Way::lost) throw device_error("failing", operation, "lost (-4)");
    return false;
  }

  class FailingQueue final : public Queue {
   public:
    explicit FailingQueue(FailingDevice& device) : device_(device) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      if (device_.meets("upload")) inner().upload(own(to), offset, from);
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      static_cast<void>(device_.meets("download"));
      inner().download(*dynamic_cast<const OwnBuffer&>(from).inner, offset, to);
    }
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      if (!device_.meets("launch " + kernel.name())) return;
      std::vector<Buffer*> inner_buffers;
      for (Buffer* buffer : buffers) inner_buffers.push_back(&own(*buffer));
      inner().launch(*dynamic_cast<const OwnKernel&>(kernel).inner, groups, inner_buffers, arguments, label);
      ++device_.fate_->launches[kernel.name()];
    }
    void wait() override {
      static_cast<void>(device_.meets("wait"));
      inner().wait();
    }

   private:
    static Buffer& own(Buffer& buffer) { return *dynamic_cast<OwnBuffer&>(buffer).inner; }
    Queue& inner() { return device_.inner_->queue(); }
    FailingDevice& device_;
  };

  std::shared_ptr<Fate> fate_;
  std::shared_ptr<Device> inner_;
  DeviceInfo info_;
  FailingQueue queue_;
};

}  // namespace interflect::test
