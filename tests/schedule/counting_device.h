#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/device/registry.h"

namespace interflect::test {

/// What a CountingDevice has seen, and what it pretends to be.
struct Counts {
  std::uint64_t allocations = 0, shares = 0, uploads = 0, downloads = 0, waits = 0;
  std::uint64_t uploaded_bytes = 0, downloaded_bytes = 0, largest_transfer = 0;
  std::string inner = "openmp";                   ///< the device that does the work
  std::map<std::string, std::uint64_t> launches;  ///< by kernel
  std::vector<std::string> labels;                ///< every launch, in order
  std::vector<std::uint64_t> allocations_at_download;
  std::uint32_t groups = 0;  ///< of the last launch
  bool may_share = true;
  std::function<void(DeviceInfo&)> describe;
  std::function<void(const std::string& kernel)> before_launch;  ///< may throw
};

/// A device, OpenMP's if no other is named, that counts what is asked of it.
class CountingDevice final : public Device {
 public:
  explicit CountingDevice(std::shared_ptr<Counts> counts)
      : counts_(std::move(counts)), inner_(open_device(counts_->inner)), info_(inner_->info()), queue_(*this) {
    if (counts_->describe) counts_->describe(info_);
  }

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override {
    ++counts_->allocations;
    return inner_->allocate(bytes);
  }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    if (!counts_->may_share) return nullptr;
    ++counts_->shares;
    return inner_->share(std::move(memory));
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    return inner_->kernel(name, macros);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  class CountingQueue final : public Queue {
   public:
    explicit CountingQueue(CountingDevice& device) : device_(device) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      ++counts().uploads;
      counts().uploaded_bytes += from.size();
      counts().largest_transfer = std::max<std::uint64_t>(counts().largest_transfer, from.size());
      inner().upload(to, offset, from);
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      ++counts().downloads;
      counts().downloaded_bytes += to.size();
      counts().largest_transfer = std::max<std::uint64_t>(counts().largest_transfer, to.size());
      counts().allocations_at_download.push_back(counts().allocations);
      inner().download(from, offset, to);
    }
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      if (counts().before_launch) counts().before_launch(kernel.name());
      ++counts().launches[kernel.name()];
      counts().labels.emplace_back(label);
      counts().groups = groups;
      inner().launch(kernel, groups, buffers, arguments, label);
    }
    void wait() override {
      ++counts().waits;
      inner().wait();
    }

   private:
    Counts& counts() { return *device_.counts_; }
    Queue& inner() { return device_.inner_->queue(); }
    CountingDevice& device_;
  };

  std::shared_ptr<Counts> counts_;
  std::unique_ptr<Device> inner_;
  DeviceInfo info_;
  CountingQueue queue_;
};

/// The one device of a Scheduler, counting into `counts`.
inline std::vector<std::unique_ptr<Device>> counting(const std::shared_ptr<Counts>& counts) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::make_unique<CountingDevice>(counts));
  return devices;
}

inline std::vector<std::unique_ptr<Device>> openmp() {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device("openmp"));
  return devices;
}

}  // namespace interflect::test
