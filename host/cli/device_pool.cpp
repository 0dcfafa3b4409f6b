#include "device_pool.h"

#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"

namespace interflect::cli {

namespace {

using Shared = DevicePool::Shared;

/// A kernel that the pool owns.
class LentKernel final : public Kernel {
 public:
  explicit LentKernel(std::shared_ptr<Kernel> kernel) : Kernel(kernel->name()), own(std::move(kernel)) {}
  const std::shared_ptr<Kernel> own;
};

/// Does `act`, and notes when the device fails in it.
template <class Act>
auto noting(Shared& shared, const Act& act) {
  try {
    return act();
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::device) shared.failed = true;
    throw;
  }
}

class LentQueue final : public Queue {
 public:
  explicit LentQueue(Shared& shared) : shared_(shared), queue_(shared.device->queue()) {}
  void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
    noting(shared_, [&] { queue_.upload(to, offset, from); });
  }
  void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
    noting(shared_, [&] { queue_.download(from, offset, to); });
  }
  void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override {
    const auto* lent = dynamic_cast<const LentKernel*>(&kernel);
    noting(shared_, [&] { queue_.launch(lent != nullptr ? *lent->own : kernel, groups, buffers, arguments, label); });
  }
  void wait() override {
    noting(shared_, [&] { queue_.wait(); });
  }

 private:
  Shared& shared_;
  Queue& queue_;
};

class LentDevice final : public Device {
 public:
  explicit LentDevice(std::shared_ptr<Shared> shared) : shared_(std::move(shared)), queue_(*shared_) {}
  [[nodiscard]] const DeviceInfo& info() const override { return shared_->device->info(); }
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override {
    return noting(*shared_, [&] { return shared_->device->allocate(bytes); });
  }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    return noting(*shared_, [&] { return shared_->device->share(std::move(memory)); });
  }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    std::shared_ptr<Kernel>& kept = shared_->kernels[{std::string(name), macros}];
    if (kept == nullptr) kept = noting(*shared_, [&] { return shared_->device->kernel(name, macros); });
    return std::make_unique<LentKernel>(kept);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  std::shared_ptr<Shared> shared_;
  LentQueue queue_;
};

}  // namespace

DevicePool::DevicePool()
    : DevicePool([](const std::string& id) { return open_device(id); },
                 [](const std::string& text) { return choose_devices(text); }) {}

std::unique_ptr<Device> DevicePool::lend(const std::string& id) {
  std::shared_ptr<Shared>& shared = devices_[id];
  if (shared != nullptr && shared->failed) shared.reset();
  if (shared == nullptr) shared = std::make_shared<Shared>(Shared{open_(id)});
  return std::make_unique<LentDevice>(shared);
}

Candidates DevicePool::candidates(const std::string& devices, ProgressSink& progress) {
  const auto known = chosen_.find(devices);
  const std::vector<std::string>& ids = known != chosen_.end() ? known->second : chosen_[devices] = choose_(devices);
  return {ids, [this](const std::string& id) { return lend(id); }, &progress};
}

}  // namespace interflect::cli
