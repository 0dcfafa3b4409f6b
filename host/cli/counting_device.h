#pragma once

#include <cstdint>
#include <memory>

#include "interflect/device/device.h"

namespace interflect::cli {

/// A device that hands everything on to another and counts the kernels that are launched through its queue.
class CountingDevice final : public Device {
 public:
  explicit CountingDevice(std::unique_ptr<Device> device) : device_(std::move(device)), queue_(device_->queue()) {}

  [[nodiscard]] const DeviceInfo& info() const override { return device_->info(); }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override { return device_->allocate(bytes); }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return device_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    return device_->kernel(name, macros);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }
  [[nodiscard]] std::uint64_t launches() const { return queue_.launches; }

 private:
  struct CountingQueue final : Queue {
    explicit CountingQueue(Queue& to) : queue(to) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      queue.upload(to, offset, from);
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      queue.download(from, offset, to);
    }
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      ++launches;
      queue.launch(kernel, groups, buffers, arguments, label);
    }
    void wait() override { queue.wait(); }
    Queue& queue;
    std::uint64_t launches = 0;
  };

  std::unique_ptr<Device> device_;
  CountingQueue queue_;
};

}  // namespace interflect::cli
