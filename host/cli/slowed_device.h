#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "interflect/base/timer.h"
#include "interflect/device/device.h"

namespace interflect::cli {

/// Another device under another id, whose products take as long as if it read F at so many bytes a second: after each
/// matvec it sleeps for the rest. What else the machine does is not seen, as long as the device itself is much faster.
class SlowedDevice final : public Device {
 public:
  SlowedDevice(std::unique_ptr<Device> device, std::string id, double bytes_per_second)
      : device_(std::move(device)), info_(device_->info()), queue_(device_->queue(), bytes_per_second) {
    info_.id = std::move(id);
  }

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override { return device_->allocate(bytes); }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return device_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    return device_->kernel(name, macros);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  struct SlowedQueue final : Queue {
    SlowedQueue(Queue& to, double bytes_per_second) : queue(to), rate(bytes_per_second) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      queue.upload(to, offset, from);
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      queue.download(from, offset, to);
    }
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      const Timer timer;
      queue.launch(kernel, groups, buffers, arguments, label);
      if (kernel.name() != "matvec") return;
      queue.wait();
      const double seconds = static_cast<double>(buffers[0]->size()) / rate;
      std::this_thread::sleep_for(std::chrono::duration<double>(seconds - timer.seconds()));
    }
    void wait() override { queue.wait(); }
    Queue& queue;
    double rate;
  };

  std::unique_ptr<Device> device_;
  DeviceInfo info_;
  SlowedQueue queue_;
};

}  // namespace interflect::cli
