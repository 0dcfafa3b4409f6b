#pragma once

#include <cstdint>
#include <memory>
#include <utility>

#include "forwarding_device.h"

namespace interflect::cli {

/// Counts the kernels that are launched through its queue.
class CountingDevice final : public ForwardingDevice {
 public:
  explicit CountingDevice(std::unique_ptr<Device> device)
      : ForwardingDevice(std::move(device)), queue_(this->device().queue()) {}

  [[nodiscard]] Queue& queue() override { return queue_; }
  [[nodiscard]] std::uint64_t launches() const { return queue_.launches; }

 private:
  struct CountingQueue final : ForwardingQueue {
    using ForwardingQueue::ForwardingQueue;
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      ++launches;
      ForwardingQueue::launch(kernel, groups, buffers, arguments, label);
    }
    std::uint64_t launches = 0;
  };

  CountingQueue queue_;
};

}  // namespace interflect::cli
