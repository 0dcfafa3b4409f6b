#include "interflect/device/cuda/cuda.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <string>
#include <utility>

#include "interflect/base/timer.h"
#include "interflect/device/cuda/api.h"
#include "interflect/device/cuda/launches.h"
#include "interflect/device/kernel_table.h"

namespace interflect::cuda {

namespace {

constexpr std::size_t staging_bytes = std::size_t{4} << 20U;

// Device-side classes, in the order of device.h: Buffer, Kernel, Queue, Device.

class Buffer final : public interflect::Buffer {
 public:
  Buffer(std::shared_ptr<Launches> launches, std::size_t bytes)
      : interflect::Buffer(bytes), launches_(std::move(launches)) {
    const Session& session = launches_->session();
    const std::string operation = fmt::format("allocate {} bytes", bytes);
    session.use(operation);
    const std::size_t at_least_one = std::max<std::size_t>(bytes, 1);
    session.check(session.cuda.memory_allocate(&memory_, at_least_one), operation, "cuMemAlloc");
    const Result filled = session.cuda.memory_fill(memory_, 0, at_least_one, launches_->stream());
    if (filled != 0) session.free(memory_);  // no destructor runs after a constructor's error
    session.check(filled, operation, "cuMemsetD8Async");
  }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() override {
    launches_->forget_memory(memory_);
    launches_->session().free(memory_);
  }

  [[nodiscard]] DevicePointer memory() const { return memory_; }

 private:
  std::shared_ptr<Launches> launches_;
  DevicePointer memory_ = 0;
};

class Kernel final : public interflect::Kernel {
 public:
  Kernel(FoundKernel found, std::shared_ptr<Launches> launches, Session::Owned<Module> module, Function* function)
      : interflect::Kernel(std::string(found.line->name)),
        found_(std::move(found)),
        launches_(std::move(launches)),
        module_(std::move(module)),
        function_(function) {}
  Kernel(const Kernel&) = delete;
  Kernel& operator=(const Kernel&) = delete;
  ~Kernel() override { launches_->forget_kernel(number_); }

  [[nodiscard]] const KernelLine& line() const { return *found_.line; }
  [[nodiscard]] const Macros& macros() const { return found_.macros; }
  [[nodiscard]] Function* function() const { return function_; }
  [[nodiscard]] std::uint64_t number() const { return number_; }

 private:
  static inline std::atomic<std::uint64_t> numbers = 0;

  FoundKernel found_;
  std::shared_ptr<Launches> launches_;
  Session::Owned<Module> module_;
  Function* function_;
  std::uint64_t number_ = ++numbers;
};

class Queue final : public interflect::Queue {
 public:
  Queue(const DeviceInfo& info, std::shared_ptr<Launches> launches)
      : info_(info), launches_(std::move(launches)), session_(launches_->session()) {
    const Driver& cuda = session_.cuda;
    session_.use("open");
    for (Staging& staging : staging_) {
      void* memory = nullptr;
      session_.check(cuda.pinned_allocate(&memory, staging_bytes, 0), "open", "cuMemHostAlloc");
      staging.memory = session_.owned(memory, cuda.pinned_free);
      Event* event = nullptr;
      session_.check(cuda.event_create(&event, event_disable_timing), "open", "cuEventCreate");
      staging.event = session_.owned(event, cuda.event_destroy);
    }
  }
  Queue(const Queue&) = delete;
  Queue& operator=(const Queue&) = delete;
  ~Queue() override {
    session_.cuda.context_use(session_.context());
    session_.cuda.stream_wait(stream());  // nothing may still be copying when the staging memory goes
  }

  void upload(interflect::Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
    const auto& buffer = own<Buffer>(to, info_.id, "upload");
    check_range(info_.id, to, offset, from.size(), "upload");
    session_.use("upload");
    launches_->end();
    while (!from.empty()) {
      const auto chunk = from.first(std::min(from.size(), staging_bytes));
      Staging& staging = next_staging("upload");
      std::memcpy(staging.memory.get(), chunk.data(), chunk.size());
      session_.check(session_.cuda.copy_in(buffer.memory() + offset, staging.memory.get(), chunk.size(), stream()),
                     "upload", "cuMemcpyHtoDAsync");
      mark(staging, "upload");
      offset += chunk.size();
      from = from.subspan(chunk.size());
    }
  }

  void download(const interflect::Buffer& from, std::size_t offset, std::span<std::byte> to) override {
    const auto& buffer = own<const Buffer>(from, info_.id, "download");
    check_range(info_.id, from, offset, to.size(), "download");
    session_.use("download");
    launches_->end();
    // While one half of the staging memory is emptied, the device fills the other.
    std::span<std::byte> before;
    Staging* filled = nullptr;
    for (; !to.empty() || filled != nullptr;) {
      const auto chunk = to.first(std::min(to.size(), staging_bytes));
      Staging* filling = nullptr;
      if (!chunk.empty()) {
        filling = &next_staging("download");
        session_.check(session_.cuda.copy_out(filling->memory.get(), buffer.memory() + offset, chunk.size(), stream()),
                       "download", "cuMemcpyDtoHAsync");
        mark(*filling, "download");
      }
      if (filled != nullptr) {
        settle(*filled, "download");
        std::memcpy(before.data(), filled->memory.get(), before.size());
      }
      filled = filling;
      before = chunk;
      offset += chunk.size();
      to = to.subspan(chunk.size());
    }
  }

  void launch(const interflect::Kernel& kernel, std::uint32_t groups, std::span<interflect::Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override {
    const auto& mine = own<const Kernel>(kernel, info_.id, "launch");
    check_launch(info_, mine.line(), mine.macros(), groups, buffers, arguments, label);
    Launch what{.kernel = mine.number(),
                .function = mine.function(),
                .groups = groups,
                .buffers = static_cast<std::uint32_t>(buffers.size()),
                .name = &kernel.name(),
                .label = std::string(label)};
    static_assert(std::tuple_size_v<decltype(what.memory)> == most_buffers);
    for (std::size_t i = 0; i < buffers.size(); ++i) {
      what.memory[i] = own<const Buffer>(*buffers[i], info_.id, "launch").memory();
    }
    if (arguments.size() > what.arguments.size()) refuse(info_.id, what.text(), "the argument block is too large");
    std::memcpy(what.arguments.data(), arguments.data(), arguments.size());
    session_.use("launch");
    launches_->launch(what);
  }

  void wait() override {
    session_.use("wait");
    launches_->end();
    session_.check(session_.cuda.stream_wait(stream()), "wait", "cuStreamSynchronize");
  }

 private:
  [[nodiscard]] Stream* stream() const { return launches_->stream(); }

  /// Pinned memory that the device copies from and to by itself, and the event after which it is free again.
  struct Staging {
    Session::Owned<void> memory;
    Session::Owned<Event> event;
    bool in_use = false;
  };

  /// The half that was used longest ago, free.
  Staging& next_staging(std::string_view operation) {
    Staging& staging = staging_[turn_ ^= 1U];
    settle(staging, operation);
    return staging;
  }
  void mark(Staging& staging, std::string_view operation) {
    session_.check(session_.cuda.event_record(staging.event.get(), stream()), operation, "cuEventRecord");
    staging.in_use = true;
  }
  void settle(Staging& staging, std::string_view operation) {
    if (!staging.in_use) return;
    session_.check(session_.cuda.event_wait(staging.event.get()), operation, "cuEventSynchronize");
    staging.in_use = false;
  }

  const DeviceInfo& info_;
  std::shared_ptr<Launches> launches_;
  const Session& session_;
  std::array<Staging, 2> staging_;
  std::size_t turn_ = 0;
};

class Device final : public interflect::Device {
 public:
  Device(DeviceInfo info, std::shared_ptr<const Session> session, const Nvrtc& nvrtc, std::string target)
      : info_(std::move(info)),
        session_(std::move(session)),
        nvrtc_(nvrtc),
        target_(std::move(target)),
        launches_(std::make_shared<Launches>(session_)),
        queue_(info_, launches_) {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> allocate(std::size_t bytes) override {
    return std::make_unique<Buffer>(launches_, bytes);
  }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> share(std::shared_ptr<const PageBuffer> /*memory*/) override {
    return nullptr;  // read over the bus, F would be slower than on the processor
  }

  [[nodiscard]] std::unique_ptr<interflect::Kernel> kernel(std::string_view name, const Macros& macros) override {
    FoundKernel found = find_kernel(info_.id, name, macros);
    const std::string operation = fmt::format("kernel {}", name);
    Macros all = found.macros;
    all.emplace("WORKGROUP", static_cast<int>(workgroup));
    const CompileKey key = compile_key(nvrtc_, target_, found.line->file, all);
    const auto build = [&] {
      return cached_compile(key, [&] { return compile(nvrtc_, key, info_.id, found.line->file); });
    };
    session_->use(operation);
    Session::Owned<Module> module;
    Result result = load(build(), module);
    if (result != 0) {  // an entry of the cache that this driver does not take
      forget_compiled(key);
      result = load(build(), module);
    }
    session_->check(result, operation, "cuModuleLoadDataEx");
    Function* function = nullptr;
    session_->check(session_->cuda.module_function(&function, module.get(), std::string(name).c_str()), operation,
                    "cuModuleGetFunction");
    return std::make_unique<Kernel>(std::move(found), launches_, std::move(module), function);
  }

  [[nodiscard]] interflect::Queue& queue() override { return queue_; }

 private:
  Result load(const std::vector<std::byte>& binary, Session::Owned<Module>& module) {
    const Timer timer;
    Module* loaded = nullptr;
    const Result result = session_->cuda.module_load(&loaded, binary.data(), 0, nullptr, nullptr);
    if (result == 0) module = session_->owned(loaded, session_->cuda.module_unload);
    add_compile_seconds(timer.seconds());
    return result;
  }

  DeviceInfo info_;
  std::shared_ptr<const Session> session_;
  const Nvrtc& nvrtc_;
  std::string target_;
  std::shared_ptr<Launches> launches_;
  Queue queue_;
};

std::string version_text(int version) {
  return fmt::format("{}.{}", version / 1000, version % 1000 / 10);
}

DeviceInfo unknown(std::uint32_t index) {
  DeviceInfo info;
  info.id = fmt::format("cuda:{}", index);
  info.backend = "cuda";
  info.name = "NVIDIA GPU";
  info.driver = "CUDA";
  info.type = DeviceType::gpu;
  return info;
}

/// A device as the driver tells of it, and what it takes to open it.
struct Found {
  DeviceEntry entry;
  int device = 0;
  const Nvrtc* nvrtc = nullptr;
  std::string target;
};

/// The first call that fails is the reason why the device is not available.
Found describe(const Driver& driver, std::uint32_t index) {
  Found found{.entry = {.info = unknown(index), .available = false, .reason = ""}, .target = ""};
  DeviceInfo& info = found.entry.info;
  std::string& reason = found.entry.reason;
  const auto ask = [&](Result result, std::string_view function) {
    if (result != 0 && reason.empty()) reason = "libcuda.so.1: " + driver.text(result, function);
  };
  const auto attribute = [&](int which) {
    int value = 0;
    ask(driver.device_attribute(&value, which, found.device), "cuDeviceGetAttribute");
    return value;
  };
  int version = 0;
  ask(driver.version(&version), "cuDriverGetVersion");
  ask(driver.device_get(&found.device, static_cast<int>(index)), "cuDeviceGet");
  if (!reason.empty()) return found;
  std::array<char, 256> name{};
  std::size_t memory = 0;
  Uuid uuid{};
  ask(driver.device_name(name.data(), static_cast<int>(name.size()) - 1, found.device), "cuDeviceGetName");
  ask(driver.device_memory(&memory, found.device), "cuDeviceTotalMem");
  ask(driver.device_uuid(&uuid, found.device), "cuDeviceGetUuid");
  info.name = name.data();
  info.driver = "CUDA " + version_text(version);
  info.memory_bytes = info.max_buffer_bytes = memory;
  info.compute_units = static_cast<std::uint32_t>(attribute(multiprocessor_count));
  int kilohertz = 0;  // newer drivers may not tell
  if (driver.device_attribute(&kilohertz, clock_rate, found.device) == 0 && kilohertz > 0) {
    info.max_clock_mhz = static_cast<std::uint32_t>(kilohertz) / 1000;
  }
  for (const unsigned char byte : uuid.bytes) info.hardware += fmt::format("{:02x}", byte);
  info.max_groups = static_cast<std::uint32_t>(attribute(max_grid_dim_x));
  info.rows_per_group = 8;
  const int capability = 10 * attribute(capability_major) + attribute(capability_minor);
  const bool prohibited = attribute(compute_mode) == compute_mode_prohibited;
  if (prohibited && reason.empty()) reason = "its compute mode is 'prohibited'";
  if (!reason.empty()) return found;

  found.nvrtc = Nvrtc::open(version / 1000, reason);
  if (found.nvrtc == nullptr) return found;
  info.driver += ", NVRTC " + found.nvrtc->version();
  found.target = found.nvrtc->target(capability);
  found.entry.available = !found.target.empty();
  if (!found.entry.available) {
    reason = fmt::format("NVRTC {} does not compile for compute capability {:.1f}; an older one may",
                         found.nvrtc->version(), capability / 10.0);
  }
  return found;
}

}  // namespace

std::vector<DeviceEntry> list_devices() {
  std::string reason;
  int count = 0;
  const Driver* driver = Driver::open(reason);
  if (driver != nullptr) {
    if (const Result result = driver->device_count(&count); result != 0) {
      reason = "libcuda.so.1: " + driver->text(result, "cuDeviceGetCount");
    } else if (count == 0) {
      reason = "libcuda.so.1: there is no device";
    }
  }
  if (!reason.empty()) return {{.info = unknown(0), .available = false, .reason = reason}};
  std::vector<DeviceEntry> all;
  all.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) all.push_back(describe(*driver, static_cast<std::uint32_t>(i)).entry);
  return all;
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t index) {
  const std::string id = unknown(index).id;
  std::string reason;
  const Driver* driver = Driver::open(reason);
  if (driver == nullptr) refuse(id, "open", reason);
  Found found = describe(*driver, index);
  if (!found.entry.available) refuse(id, "open", found.entry.reason);
  auto session = std::make_shared<const Session>(*driver, id, found.device);
  return std::make_unique<Device>(std::move(found.entry.info), std::move(session), *found.nvrtc,
                                  std::move(found.target));
}

}  // namespace interflect::cuda
