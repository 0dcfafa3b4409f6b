#pragma once

#include <memory>
#include <utility>

#include "interflect/device/device.h"

namespace interflect::cli {

/// A queue that hands everything on to another, for those that see or change some of it.
class ForwardingQueue : public Queue {
 public:
  explicit ForwardingQueue(Queue& to) : to_(to) {}
  void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
    to_.upload(to, offset, from);
  }
  void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
    to_.download(from, offset, to);
  }
  void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override {
    to_.launch(kernel, groups, buffers, arguments, label);
  }
  void wait() override { to_.wait(); }

 private:
  Queue& to_;
};

/// A device that is another one but for its queue.
class ForwardingDevice : public Device {
 public:
  explicit ForwardingDevice(std::unique_ptr<Device> device) : device_(std::move(device)) {}
  [[nodiscard]] const DeviceInfo& info() const override { return device_->info(); }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override { return device_->allocate(bytes); }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return device_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    return device_->kernel(name, macros);
  }

 protected:
  [[nodiscard]] Device& device() const { return *device_; }

 private:
  std::unique_ptr<Device> device_;
};

}  // namespace interflect::cli
