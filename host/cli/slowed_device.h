#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "forwarding_device.h"
#include "interflect/base/timer.h"

namespace interflect::cli {

/// Another device under another id, whose products take as long as if it read F at so many bytes a second: after each
/// matvec it sleeps for the rest. What else the machine does is not seen, as long as the device itself is much faster.
class SlowedDevice final : public ForwardingDevice {
 public:
  SlowedDevice(std::unique_ptr<Device> device, std::string id, double bytes_per_second)
      : ForwardingDevice(std::move(device)),
        info_(this->device().info()),
        queue_(this->device().queue(), bytes_per_second) {
    info_.id = std::move(id);
  }

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  struct SlowedQueue final : ForwardingQueue {
    SlowedQueue(Queue& to, double bytes_per_second) : ForwardingQueue(to), rate(bytes_per_second) {}
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      const Timer timer;
      ForwardingQueue::launch(kernel, groups, buffers, arguments, label);
      if (kernel.name() != "matvec") return;
      wait();
      const double seconds = static_cast<double>(buffers[0]->size()) / rate;
      std::this_thread::sleep_for(std::chrono::duration<double>(seconds - timer.seconds()));
    }
    double rate;
  };

  DeviceInfo info_;
  SlowedQueue queue_;
};

}  // namespace interflect::cli
