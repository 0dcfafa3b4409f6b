#pragma once

#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "interflect/device/device.h"

namespace interflect::test {

/// A launch as a replacement for a kernel sees it: every buffer's floats, written back when it returns.
struct Launched {
  std::vector<std::vector<float>> buffers;
  std::span<const std::byte> arguments;
  Macros macros;
  std::uint32_t groups = 0;

  template <class Arguments>
  [[nodiscard]] Arguments as() const {
    Arguments block;
    std::memcpy(&block, arguments.data(), sizeof block);
    return block;
  }
};

/// A device that is another one, except that one of its kernels is replaced by a function of the test's own.
class ReplacedKernelDevice final : public Device {
 public:
  using Replacement = std::function<void(Launched&)>;

  ReplacedKernelDevice(std::unique_ptr<Device> inner, std::string_view kernel, Replacement replacement)
      : inner_(std::move(inner)), info_(inner_->info()), queue_(inner_->queue(), kernel, std::move(replacement)) {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  /// Makes the device state that no buffer may be larger.
  void limit_buffers(std::uint64_t bytes) { info_.max_buffer_bytes = bytes; }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override { return inner_->allocate(bytes); }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return inner_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    queue_.macros = macros;  // those of the kernel made last: enough for a test that makes one at a time
    return inner_->kernel(name, macros);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  struct ReplacingQueue final : Queue {
    ReplacingQueue(Queue& real, std::string_view name, Replacement function)
        : inner(real), kernel(name), replacement(std::move(function)) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      inner.upload(to, offset, from);
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      inner.download(from, offset, to);
    }
    void launch(const Kernel& launched, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      if (launched.name() != kernel) return inner.launch(launched, groups, buffers, arguments, label);
      Launched call{{}, arguments, macros, groups};
      for (const Buffer* buffer : buffers) {
        auto& values = call.buffers.emplace_back(buffer->size() / sizeof(float));
        inner.download(*buffer, 0, std::as_writable_bytes(std::span(values)));
      }
      replacement(call);
      for (std::size_t i = 0; i < buffers.size(); ++i) {
        inner.upload(*buffers[i], 0, std::as_bytes(std::span(call.buffers[i])));
      }
    }
    void wait() override { inner.wait(); }

    Queue& inner;
    std::string_view kernel;
    Replacement replacement;
    Macros macros;
  };

  std::unique_ptr<Device> inner_;
  DeviceInfo info_;
  ReplacingQueue queue_;
};

}  // namespace interflect::test
