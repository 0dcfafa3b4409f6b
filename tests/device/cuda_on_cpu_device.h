#pragma once

#include <array>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "device/cuda_on_cpu.h"
#include "interflect/base/error.h"
#include "interflect/device/kernel_table.h"

namespace interflect::test {

/// The kernels of kernels/cuda/ on the processor, behind the interface of a device: "cuda-on-cpu". With a variant, the
/// kernels have that defect (tests/device/fake_cuda/CMakeLists.txt lists them).
class CudaOnCpu final : public Device {
 public:
  /// Buffers of 300,000 bytes take matrices of up to 257 rows: enough for most of what can go wrong, in a fifth of the
  /// time.
  static constexpr std::uint64_t small = 300000, large = std::uint64_t{1} << 30U;

  explicit CudaOnCpu(std::string variant = "", std::uint64_t largest_buffer = large, std::uint32_t rows_per_group = 8)
      : variant_(std::move(variant)), queue_(info_) {
    info_.id = "cuda-on-cpu";
    info_.backend = "cuda-on-cpu";
    info_.max_buffer_bytes = largest_buffer;
    info_.rows_per_group = rows_per_group;
  }

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  /// Exactly as large as asked for, so that AddressSanitizer sees an access behind the end.
  [[nodiscard]] std::unique_ptr<Buffer> allocate(std::size_t bytes) override { return std::make_unique<Memory>(bytes); }
  [[nodiscard]] std::unique_ptr<Buffer> share(std::shared_ptr<const PageBuffer> /*memory*/) override { return nullptr; }
  [[nodiscard]] std::unique_ptr<Kernel> kernel(std::string_view name, const Macros& macros) override {
    FoundKernel found = find_kernel(info_.id, name, macros);
    const cuda_on_cpu::Compiled* compiled = cuda_on_cpu::find(variant_, std::string(name), found.macros);
    if (compiled == nullptr) refuse(info_.id, "kernel " + std::string(name), "not built with these macros");
    if (compiled->variant != variant_ && cuda_on_cpu::changes(variant_, compiled->kernel)) {
      throw Error(ErrorKind::limit, "the defect is not built with these macros");
    }
    return std::make_unique<Entry>(std::move(found), *compiled);
  }
  [[nodiscard]] Queue& queue() override { return queue_; }

 private:
  struct Memory final : Buffer {
    explicit Memory(std::size_t bytes) : Buffer(bytes), data(new (std::align_val_t{64}) std::byte[bytes]()) {}
    struct Delete {
      void operator()(std::byte* p) const { ::operator delete[](p, std::align_val_t{64}); }
    };
    std::unique_ptr<std::byte[], Delete> data;
  };

  struct Entry final : Kernel {
    Entry(FoundKernel of, const cuda_on_cpu::Compiled& function)
        : Kernel(std::string(of.line->name)), found(std::move(of)), compiled(function) {}
    FoundKernel found;
    const cuda_on_cpu::Compiled& compiled;
  };

  struct Order final : Queue {
    explicit Order(const DeviceInfo& of) : info(of) {}
    void upload(Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
      check_range(info.id, to, offset, from.size(), "upload");
      std::memcpy(own<Memory>(to, info.id, "upload").data.get() + offset, from.data(), from.size());
    }
    void download(const Buffer& from, std::size_t offset, std::span<std::byte> to) override {
      check_range(info.id, from, offset, to.size(), "download");
      std::memcpy(to.data(), own<const Memory>(from, info.id, "download").data.get() + offset, to.size());
    }
    void launch(const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
                std::span<const std::byte> arguments, std::string_view label) override {
      const auto& mine = own<const Entry>(kernel, info.id, "launch");
      check_launch(info, *mine.found.line, mine.found.macros, groups, buffers, arguments, label);
      std::array<void*, 8> pointers{};
      std::array<void*, 9> parameters{};
      for (std::size_t i = 0; i < buffers.size(); ++i) {
        pointers[i] = own<const Memory>(*buffers[i], info.id, "launch").data.get();
        parameters[i] = &pointers[i];
      }
      std::vector<std::byte> block(arguments.begin(), arguments.end());
      parameters[buffers.size()] = block.data();
      try {
        cuda_on_cpu::run(mine.compiled, groups, 256, parameters.data());
      } catch (const std::runtime_error& error) {
        refuse(info.id, "launch", error.what());
      }
    }
    void wait() override {}
    const DeviceInfo& info;
  };

  std::string variant_;
  DeviceInfo info_;
  Order queue_;
};

}  // namespace interflect::test
