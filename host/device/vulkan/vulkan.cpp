#include "interflect/device/vulkan/vulkan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/compile_cache.h"
#include "interflect/device/kernel_source.h"
#include "interflect/device/vulkan/api.h"
#include "interflect/device/vulkan/commands.h"
#include "interflect/device/vulkan/glsl.h"
#include "interflect/device/vulkan/program.h"

namespace interflect::vulkan {

namespace {

// Device-side classes, in the order of device.h: Buffer, Kernel, Queue, Device.

class Queue;

/// Of a buffer or kernel and no other, ever.
std::uint64_t new_number() {
  static std::atomic<std::uint64_t> last = 0;
  return ++last;
}

class Buffer final : public interflect::Buffer {
 public:
  Buffer(std::size_t bytes, const Context& context, std::shared_ptr<Queue> queue);
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() override;

  [[nodiscard]] const Memory& memory() const { return memory_; }
  /// As texels of a format of 16 bytes; null for the undefined one.
  [[nodiscard]] vk::BufferView texels(vk::Format format) const;
  [[nodiscard]] std::uint64_t number() const { return number_; }

 private:
  std::shared_ptr<Queue> queue_;  ///< goes last: the API's device lives as long
  std::uint64_t number_ = new_number();
  Memory memory_;
  vk::raii::BufferView floats_ = nullptr, words_ = nullptr;  ///< where the shape reads by texels
};

class Kernel final : public interflect::Kernel {
 public:
  Kernel(FoundKernel found, std::shared_ptr<const Program> program, std::shared_ptr<Queue> queue)
      : interflect::Kernel(std::string(found.line->name)),
        queue_(std::move(queue)),
        found_(std::move(found)),
        program_(std::move(program)) {}
  Kernel(const Kernel&) = delete;
  Kernel& operator=(const Kernel&) = delete;
  ~Kernel() override;

  [[nodiscard]] const KernelLine& line() const { return *found_.line; }
  [[nodiscard]] const Macros& macros() const { return found_.macros; }
  [[nodiscard]] const Program& program() const { return *program_; }
  [[nodiscard]] std::uint64_t number() const { return number_; }

 private:
  std::shared_ptr<Queue> queue_;  ///< goes last: the API's device lives as long
  std::uint64_t number_ = new_number();
  FoundKernel found_;
  std::shared_ptr<const Program> program_;
};

class Queue final : public interflect::Queue {
 public:
  Queue(std::shared_ptr<Context> context, const DeviceInfo& info, bool ordered)
      : context_(std::move(context)), info_(info), commands_(context_, ordered) {}

  void upload(interflect::Buffer& to, std::size_t offset, std::span<const std::byte> from) override;
  void download(const interflect::Buffer& from, std::size_t offset, std::span<std::byte> to) override;
  void launch(const interflect::Kernel& kernel, std::uint32_t groups, std::span<interflect::Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override;
  void wait() override;

  /// Fills a new buffer with zeros.
  void clear(const Buffer& buffer);
  /// Before a buffer or kernel goes: waits for what may use it and drops the descriptor sets that name it.
  void forget(std::uint64_t number) noexcept;

 private:
  struct Set {
    vk::raii::DescriptorPool pool = nullptr;
    vk::raii::DescriptorSet set = nullptr;
  };
  /// Throws a device Error if forget() has lost commands since the last call.
  void check_lost(std::string_view operation);

  using Key = std::array<std::uint64_t, 9>;  ///< numbers of a kernel and its buffers; no kernel takes more

  vk::DescriptorSet bind(const Kernel& kernel, std::span<interflect::Buffer* const> buffers);
  Set make_set(const Kernel& kernel, std::span<interflect::Buffer* const> buffers);

  std::shared_ptr<Context> context_;
  const DeviceInfo& info_;
  std::map<Key, Set> sets_;
  std::optional<vk::Result> lost_;  ///< why commands that forget() handed over are lost
  Commands commands_;               ///< goes first
};

constexpr std::size_t rounded(std::size_t bytes) {
  return std::max<std::size_t>(64, (bytes + 63) / 64 * 64);  // whole fours
}

Buffer::Buffer(std::size_t bytes, const Context& context, std::shared_ptr<Queue> queue)
    : interflect::Buffer(bytes), queue_(std::move(queue)) {
  using Usage = vk::BufferUsageFlagBits;
  vk::BufferUsageFlags usage = Usage::eStorageBuffer | Usage::eTransferSrc | Usage::eTransferDst;
  if (context.adapter.shape.texel) usage |= Usage::eStorageTexelBuffer;
  memory_ =
      allocate_memory(context, rounded(bytes), usage, context.adapter.shape.staged ? Place::device : Place::shared);
  if (context.adapter.shape.texel) {
    const auto view = [&](vk::Format format) {
      return vk::raii::BufferView(context.device, {{}, *memory_.buffer, format, 0, VK_WHOLE_SIZE});
    };
    floats_ = view(vk::Format::eR32G32B32A32Sfloat);
    words_ = view(vk::Format::eR32G32B32A32Uint);
  }
}

vk::BufferView Buffer::texels(vk::Format format) const {
  if (format == vk::Format::eUndefined) return nullptr;
  return format == vk::Format::eR32G32B32A32Uint ? *words_ : *floats_;
}

Buffer::~Buffer() {
  queue_->forget(number_);
}

Kernel::~Kernel() {
  queue_->forget(number_);
}

void Queue::upload(interflect::Buffer& to, std::size_t offset, std::span<const std::byte> from) {
  auto& buffer = own<Buffer>(to, info_.id, "upload");
  check_range(info_.id, to, offset, from.size(), "upload");
  check_lost("upload");
  if (from.empty()) return;
  const Memory& memory = buffer.memory();
  attempt(info_.id, "upload", [&] {
    if (memory.mapped == nullptr) return commands_.copy_in(from, *memory.buffer, offset);
    commands_.finish();  // what runs may still use the old contents
    std::memcpy(memory.mapped + offset, from.data(), from.size());
  });
}

void Queue::download(const interflect::Buffer& from, std::size_t offset, std::span<std::byte> to) {
  const auto& buffer = own<const Buffer>(from, info_.id, "download");
  check_range(info_.id, from, offset, to.size(), "download");
  check_lost("download");
  const Memory& memory = buffer.memory();
  attempt(info_.id, "download", [&] {
    // A copy comes behind what was launched and is waited for: one wait.
    if (to.empty()) return commands_.finish();
    if (memory.mapped == nullptr) return commands_.copy_out(*memory.buffer, offset, to);
    commands_.finish();
    std::memcpy(to.data(), memory.mapped + offset, to.size());
  });
  Messages::all().raise(info_.id, "download");
}

void Queue::launch(const interflect::Kernel& kernel, std::uint32_t groups, std::span<interflect::Buffer* const> buffers,
                   std::span<const std::byte> arguments, std::string_view label) {
  const auto& mine = own<const Kernel>(kernel, info_.id, "launch");
  check_launch(info_, mine.line(), mine.macros(), groups, buffers, arguments, label);
  const std::string operation = fmt::format("launch {} ({})", mine.name(), label);
  check_lost(operation);
  attempt(info_.id, operation, [&] {
    const vk::DescriptorSet set = bind(mine, buffers);
    const vk::CommandBuffer commands = commands_.next();
    const auto& d = *context_->device.getDispatcher();
    const Program& program = mine.program();
    commands.bindPipeline(vk::PipelineBindPoint::eCompute, *program.pipeline, d);
    commands.bindDescriptorSets(vk::PipelineBindPoint::eCompute, *program.layout, 0, set, nullptr, d);
    commands.pushConstants(*program.layout, vk::ShaderStageFlagBits::eCompute, 0,
                           static_cast<std::uint32_t>(arguments.size()), arguments.data(), d);
    commands.dispatch(program.chunks, groups, 1, d);
  });
}

void Queue::wait() {
  check_lost("wait");
  attempt(info_.id, "wait", [&] { commands_.finish(); });
  Messages::all().raise(info_.id, "wait");
}

void Queue::clear(const Buffer& buffer) {
  if (buffer.memory().mapped != nullptr) {
    std::memset(buffer.memory().mapped, 0, rounded(buffer.size()));
  } else {
    commands_.next().fillBuffer(*buffer.memory().buffer, 0, VK_WHOLE_SIZE, 0, *context_->device.getDispatcher());
  }
}

void Queue::forget(std::uint64_t number) noexcept {
  for (int i = 0; i < 2; ++i) {  // where the first fails to hand over, the second waits for what runs
    try {
      commands_.finish();
      break;
    } catch (const vk::SystemError& error) {
      if (!lost_) lost_ = static_cast<vk::Result>(error.code().value());
    } catch (...) {
      if (!lost_) lost_ = vk::Result::eErrorUnknown;
    }
  }
  std::erase_if(sets_, [&](const auto& entry) {
    return std::find(entry.first.begin(), entry.first.end(), number) != entry.first.end();
  });
}

void Queue::check_lost(std::string_view operation) {
  if (!lost_) return;
  refuse(info_.id, operation, fmt::format("commands before it were lost: {}", text(*std::exchange(lost_, {}))));
}

/// The descriptor set of a kernel with these buffers: made at the first launch, then used again.
vk::DescriptorSet Queue::bind(const Kernel& kernel, std::span<interflect::Buffer* const> buffers) {
  Key key{kernel.number()};
  for (std::size_t i = 0; i < buffers.size(); ++i) key[i + 1] = own<Buffer>(*buffers[i], info_.id, "launch").number();
  auto found = sets_.find(key);
  if (found == sets_.end()) found = sets_.emplace(key, make_set(kernel, buffers)).first;
  return *found->second.set;
}

Queue::Set Queue::make_set(const Kernel& kernel, std::span<interflect::Buffer* const> buffers) {
  std::vector<vk::DescriptorPoolSize> sizes;
  for (std::size_t i = 0; i < buffers.size(); ++i) sizes.emplace_back(kernel.program().types[i], 1);
  Set made;
  made.pool = {context_->device, {vk::DescriptorPoolCreateFlagBits::eFreeDescriptorSet, 1, sizes}};
  const vk::DescriptorSetLayout layout = *kernel.program().set_layout;
  made.set = std::move(vk::raii::DescriptorSets(context_->device, {*made.pool, layout}).front());
  std::vector<vk::DescriptorBufferInfo> whole;
  std::vector<vk::BufferView> texels;
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    const auto& mine = own<const Buffer>(*buffers[i], info_.id, "launch");
    whole.emplace_back(*mine.memory().buffer, 0, VK_WHOLE_SIZE);
    texels.push_back(mine.texels(kernel.program().texels[i]));
  }
  std::vector<vk::WriteDescriptorSet> writes;
  for (std::uint32_t i = 0; i < buffers.size(); ++i) {
    writes.emplace_back(*made.set, i, 0, 1, kernel.program().types[i], nullptr, &whole[i], &texels[i]);
  }
  context_->device.updateDescriptorSets(writes, nullptr);
  return made;
}

class Device final : public interflect::Device {
 public:
  Device(DeviceInfo info, std::shared_ptr<Context> context, bool ordered)
      : info_(std::move(info)),
        context_(std::move(context)),
        queue_(attempt(info_.id, "open", [&] { return std::make_shared<Queue>(context_, info_, ordered); })) {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> allocate(std::size_t bytes) override {
    const std::string operation = fmt::format("allocate {} bytes", bytes);
    if (bytes > info_.max_buffer_bytes) {
      refuse(info_.id, operation, fmt::format("a buffer has {} at most", info_.max_buffer_bytes));
    }
    return attempt(info_.id, operation, [&] {
      auto buffer = std::make_unique<Buffer>(bytes, *context_, queue_);
      queue_->clear(*buffer);
      return buffer;
    });
  }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    if (memory == nullptr) refuse(info_.id, "share", "no memory given");
    return nullptr;  // would need an extension
  }

  [[nodiscard]] std::unique_ptr<interflect::Kernel> kernel(std::string_view name, const Macros& macros) override;

  [[nodiscard]] interflect::Queue& queue() override { return *queue_; }

 private:
  DeviceInfo info_;
  std::shared_ptr<Context> context_;
  std::shared_ptr<Queue> queue_;
  std::map<std::string, std::shared_ptr<const Program>> programs_;  ///< by their sources
};

std::unique_ptr<interflect::Kernel> Device::kernel(std::string_view name, const Macros& macros) {
  FoundKernel found = find_kernel(info_.id, name, macros);
  const std::string operation = fmt::format("kernel {}", name);
  const std::string options = preamble(found, context_->adapter.shape);
  const std::string source = kernel_source("glsl", fmt::format("{}.comp", found.line->file));
  // SPIR-V is the same for all devices; what a driver makes of it, the driver keeps.
  const CompileKey key{"vulkan", "SPIR-V 1.3", glslang_version(), options, source};
  std::vector<std::byte> binary;
  try {
    binary = cached_compile(key, [&] { return compile_glsl(options + source); });
  } catch (const std::string& log) {
    throw Error(ErrorKind::device, fmt::format("{}: {}: {}", info_.id, operation, log));  // with the log's lines
  }
  std::shared_ptr<const Program>& program = programs_[options + source];
  if (program == nullptr) {
    const Timer timer;
    program = attempt(info_.id, operation, [&] { return std::make_shared<const Program>(found, *context_, binary); });
    add_compile_seconds(timer.seconds());
  }
  return std::make_unique<Kernel>(std::move(found), program, queue_);
}

DeviceType device_type(vk::PhysicalDeviceType type) {
  switch (type) {
    case vk::PhysicalDeviceType::eCpu: return DeviceType::cpu;
    case vk::PhysicalDeviceType::eDiscreteGpu:
    case vk::PhysicalDeviceType::eIntegratedGpu:
    case vk::PhysicalDeviceType::eVirtualGpu: return DeviceType::gpu;
    default: return DeviceType::other;
  }
}

std::uint64_t local_memory(const vk::raii::PhysicalDevice& physical) {
  std::uint64_t largest = 0;
  const vk::PhysicalDeviceMemoryProperties memory = physical.getMemoryProperties();
  for (std::uint32_t i = 0; i < memory.memoryHeapCount; ++i) {
    const bool local = static_cast<bool>(memory.memoryHeaps[i].flags & vk::MemoryHeapFlagBits::eDeviceLocal);
    if (local) largest = std::max<std::uint64_t>(largest, memory.memoryHeaps[i].size);
  }
  return largest;
}

DeviceInfo describe(std::string id, const Adapter& adapter) {
  const vk::PhysicalDeviceLimits& limits = adapter.properties.limits;
  DeviceInfo info{.id = std::move(id),
                  .backend = "vulkan",
                  .name = adapter.properties.deviceName.data(),
                  .driver = adapter.driver,
                  .type = device_type(adapter.properties.deviceType),
                  .memory_bytes = local_memory(adapter.physical),
                  .max_buffer_bytes = limits.maxStorageBufferRange,
                  .hardware = {}};
  const bool cpu = info.type == DeviceType::cpu;
  if (cpu) info.compute_units = std::thread::hardware_concurrency();  // of a GPU the core of Vulkan does not tell
  if (info.type == DeviceType::gpu) info.hardware = adapter.uuid;
  // In kernels/glsl the groups lie along y; read multiplies two numbers of groups in 32 bits.
  info.max_groups = std::min(65535U, limits.maxComputeWorkGroupCount[1]);
  if (!adapter.reason.empty()) return info;
  info.rows_per_group = adapter.shape.rows;
  const std::uint64_t texels = adapter.shape.texel ? limits.maxTexelBufferElements : UINT32_MAX;
  const std::uint64_t most = std::min({info.max_buffer_bytes, adapter.max_allocation, texels * 16});
  info.max_buffer_bytes = most / 64 * 64;
  return info;
}

/// The one entry that says why there is none.
std::vector<DeviceEntry> none(std::string reason) {
  DeviceEntry entry{.info = {.id = "vulkan:0", .backend = "vulkan", .name = {}, .driver = {}, .hardware = {}},
                    .available = false,
                    .reason = std::move(reason)};
  return {std::move(entry)};
}

}  // namespace

std::vector<DeviceEntry> list_devices() {
  std::vector<DeviceEntry> entries;
  try {
    const Instance instance;
    for (const Adapter& adapter : adapters(instance)) {
      DeviceInfo info = describe(fmt::format("vulkan:{}", entries.size()), adapter);
      entries.push_back({std::move(info), adapter.reason.empty(), adapter.reason});
    }
  } catch (const vk::IncompatibleDriverError& error) {
    return none(fmt::format("no Vulkan driver found: {}", text(error)));
  } catch (const vk::SystemError& error) {
    return none(fmt::format("libvulkan: {}", text(error)));
  } catch (const std::string& cause) {
    return none(cause);
  }
  if (entries.empty()) return none("no Vulkan device found");
  return entries;
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t index) {
  return open_device(open_context(index), true);
}

std::unique_ptr<interflect::Device> open_device(std::shared_ptr<Context> context, bool ordered) {
  DeviceInfo info = describe(context->id, context->adapter);
  return std::make_unique<Device>(std::move(info), std::move(context), ordered);
}

}  // namespace interflect::vulkan
