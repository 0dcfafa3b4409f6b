#include "interflect/device/opencl/opencl.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdlib>
#include <cstring>
#include <set>
#include <string>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/kernel_source.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/opencl/api.h"

namespace interflect::opencl {

namespace {

// Device-side classes, in the order of device.h: Buffer, Kernel, Queue, Device.

class Buffer final : public interflect::Buffer {
 public:
  Buffer(std::size_t bytes, Memory memory, bool read_only = false)
      : interflect::Buffer(bytes, read_only), memory_(std::move(memory)) {}

  [[nodiscard]] cl_mem memory() const { return memory_.get(); }
  /// Never the same for two buffers of a process, as an address is when one is made after the other is gone.
  [[nodiscard]] std::uint64_t serial() const { return serial_; }

 private:
  static inline std::atomic<std::uint64_t> last_serial{0};
  Memory memory_;
  std::uint64_t serial_ = ++last_serial;
};

class Kernel final : public interflect::Kernel {
 public:
  Kernel(FoundKernel found, EntryPoint entry)
      : interflect::Kernel(std::string(found.line->name)), found_(std::move(found)), entry_(std::move(entry)) {}

  [[nodiscard]] const KernelLine& line() const { return *found_.line; }
  [[nodiscard]] const Macros& macros() const { return found_.macros; }
  [[nodiscard]] cl_kernel entry() const { return entry_.get(); }

  /// Sets the arguments that are not what they were at the last launch: half of a launch's time otherwise.
  [[nodiscard]] cl_int bind(std::span<const Buffer* const> buffers, std::span<const std::byte> arguments) const {
    cl_uint index = 0;
    for (const Buffer* buffer : buffers) {
      if (bound_[index] != buffer->serial()) {
        const cl_mem memory = buffer->memory();
        bound_[index] = 0;
        if (const cl_int code = clSetKernelArg(entry(), index, sizeof(cl_mem), &memory); code != CL_SUCCESS)
          return code;
        bound_[index] = buffer->serial();
      }
      ++index;
    }
    if (std::equal(arguments.begin(), arguments.end(), arguments_.begin(), arguments_.end())) return CL_SUCCESS;
    arguments_.clear();
    const cl_int code = clSetKernelArg(entry(), index, arguments.size(), arguments.data());
    if (code == CL_SUCCESS) arguments_.assign(arguments.begin(), arguments.end());
    return code;
  }

 private:
  FoundKernel found_;
  EntryPoint entry_;
  mutable std::array<std::uint64_t, 8> bound_{};  ///< no kernel takes more buffers
  mutable std::vector<std::byte> arguments_;
};

class Queue final : public interflect::Queue {
 public:
  Queue(const DeviceInfo& info, std::size_t workgroup, CommandQueue queue)
      : info_(info), workgroup_(workgroup), queue_(std::move(queue)) {}
  Queue(const Queue&) = delete;
  Queue& operator=(const Queue&) = delete;
  ~Queue() override { clFinish(queue_.get()); }  // staged bytes may still be on their way

  void upload(interflect::Buffer& to, std::size_t offset, std::span<const std::byte> from) override {
    const auto& buffer = own<Buffer>(to, info_.id, "upload");
    check_range(info_.id, to, offset, from.size(), "upload");
    if (from.empty()) return;
    const bool stage = from.size() <= largest_staged - staged_bytes_;
    if (stage) from = staged_.emplace_back(from.begin(), from.end());
    const cl_int code = clEnqueueWriteBuffer(queue_.get(), buffer.memory(), stage ? CL_FALSE : CL_TRUE, offset,
                                             from.size(), from.data(), 0, nullptr, nullptr);
    succeed(code, info_.id, "upload", "clEnqueueWriteBuffer");
    stage ? void(staged_bytes_ += from.size()) : finished();
  }

  void download(const interflect::Buffer& from, std::size_t offset, std::span<std::byte> to) override {
    const auto& buffer = own<const Buffer>(from, info_.id, "download");
    check_range(info_.id, from, offset, to.size(), "download");
    if (to.empty()) return;
    const cl_int code =
        clEnqueueReadBuffer(queue_.get(), buffer.memory(), CL_TRUE, offset, to.size(), to.data(), 0, nullptr, nullptr);
    succeed(code, info_.id, "download", "clEnqueueReadBuffer");
    finished();
  }

  void launch(const interflect::Kernel& kernel, std::uint32_t groups, std::span<interflect::Buffer* const> buffers,
              std::span<const std::byte> arguments, std::string_view label) override {
    const auto& mine = own<const Kernel>(kernel, info_.id, "launch");
    check_launch(info_, mine.line(), mine.macros(), groups, buffers, arguments, label);
    std::array<const Buffer*, 8> bound{};  // no kernel takes more
    for (std::size_t i = 0; i < buffers.size(); ++i) bound[i] = &own<const Buffer>(*buffers[i], info_.id, "launch");
    run(mine, groups, std::span(bound).first(buffers.size()), arguments, label);
  }

  void wait() override {
    succeed(clFinish(queue_.get()), info_.id, "wait", "clFinish");
    finished();
  }

  /// A launch that has been checked.
  void run(const Kernel& kernel, std::uint32_t groups, std::span<const Buffer* const> buffers,
           std::span<const std::byte> arguments, std::string_view label) {
    const auto check = [&](cl_int code, std::string_view function) {
      if (code != CL_SUCCESS) succeed(code, info_.id, fmt::format("launch {} ({})", kernel.name(), label), function);
    };
    check(kernel.bind(buffers, arguments), "clSetKernelArg");
    const std::size_t items = groups * workgroup_;
    check(clEnqueueNDRangeKernel(queue_.get(), kernel.entry(), 1, nullptr, &items, &workgroup_, 0, nullptr, nullptr),
          "clEnqueueNDRangeKernel");
  }

  void fill_with_zeros(const Buffer& buffer, std::size_t bytes, std::string_view operation) {
    const std::array<cl_uint, 4> zeros{};
    succeed(
        clEnqueueFillBuffer(queue_.get(), buffer.memory(), zeros.data(), sizeof zeros, 0, bytes, 0, nullptr, nullptr),
        info_.id, operation, "clEnqueueFillBuffer");
  }

 private:
  /// Everything enqueued is done.
  void finished() {
    staged_.clear();
    staged_bytes_ = 0;
  }

  static constexpr std::size_t largest_staged = std::size_t{4} << 20;
  const DeviceInfo& info_;
  std::size_t workgroup_;
  std::vector<std::vector<std::byte>> staged_;  ///< small uploads do not wait: their bytes stay here meanwhile
  std::size_t staged_bytes_ = 0;
  CommandQueue queue_;
};

/// How kernels are cut for a device; kernels/cl/ has the same names as macros.
struct Shape {
  std::size_t workgroup = 1;  ///< WORKGROUP: work-items of a group; 1 is the CPU's shape
  unsigned width = 16;        ///< WIDTH: floats of a vector register, in the CPU's shape
};

constexpr std::uint32_t rows_per_group = 8;

class Device final : public interflect::Device {
 public:
  Device(const Found& found, DeviceInfo info, Shape shape)
      : found_(found),
        info_(std::move(info)),
        shape_(shape),
        context_(make_context()),
        queue_(info_, shape.workgroup, make_queue()) {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> allocate(std::size_t bytes) override {
    const std::string operation = fmt::format("allocate {} bytes", bytes);
    if (bytes > info_.max_buffer_bytes) {
      refuse(info_.id, operation, fmt::format("its largest buffer is {} bytes", info_.max_buffer_bytes));
    }
    if (info_.type == DeviceType::cpu && bytes >= huge_page) {  // in huge pages, and zero already
      try {
        auto pages = std::make_shared<PageBuffer>(bytes);
        return std::make_unique<Buffer>(bytes, over(std::move(pages), CL_MEM_READ_WRITE, operation));
      } catch (const Error& error) {
        if (error.kind() == ErrorKind::device) throw;
        refuse(info_.id, operation, error.what());
      }
    }
    const std::size_t whole = std::max<std::size_t>(16, (bytes + 15) / 16 * 16);
    auto buffer = std::make_unique<Buffer>(bytes, make_memory(CL_MEM_READ_WRITE, whole, nullptr, operation));
    queue_.fill_with_zeros(*buffer, whole, operation);
    return buffer;
  }

  [[nodiscard]] std::unique_ptr<interflect::Buffer> share(std::shared_ptr<const PageBuffer> memory) override {
    if (memory == nullptr) refuse(info_.id, "share", "no memory given");
    const std::size_t bytes = memory->size();
    if (info_.type != DeviceType::cpu || !unified_memory() || bytes == 0 || bytes > info_.max_buffer_bytes) {
      return nullptr;
    }
    return std::make_unique<Buffer>(bytes, over(std::move(memory), CL_MEM_READ_ONLY, "share"), true);
  }

  [[nodiscard]] std::unique_ptr<interflect::Kernel> kernel(std::string_view name, const Macros& macros) override {
    FoundKernel found = find_kernel(info_.id, name, macros);
    const std::string operation = fmt::format("kernel {}", name);
    const std::string options = options_for(found.macros);
    cl_program program = program_of(std::string(found.line->file), options, operation);
    cl_int code = CL_SUCCESS;
    // A prefix: OpenCL C has functions of its own called dot and the like.
    EntryPoint entry(clCreateKernel(program, fmt::format("interflect_{}", name).c_str(), &code));
    succeed(code, info_.id, operation, "clCreateKernel");
    auto kernel = std::make_unique<Kernel>(std::move(found), std::move(entry));
    if (warm_.insert(fmt::format("{} {}", name, options)).second) warm_up(*kernel);
    return kernel;
  }

  [[nodiscard]] interflect::Queue& queue() override { return queue_; }

 private:
  [[nodiscard]] Context make_context() {
    const std::array<cl_context_properties, 3> properties{CL_CONTEXT_PLATFORM,
                                                          std::bit_cast<cl_context_properties>(found_.platform), 0};
    cl_int code = CL_SUCCESS;
    Context context(clCreateContext(properties.data(), 1, &found_.device, nullptr, nullptr, &code));
    succeed(code, info_.id, "open", "clCreateContext");
    return context;
  }

  [[nodiscard]] CommandQueue make_queue() {
    cl_int code = CL_SUCCESS;
    CommandQueue queue(clCreateCommandQueue(context_.get(), found_.device, 0, &code));  // in order
    succeed(code, info_.id, "open", "clCreateCommandQueue");
    return queue;
  }

  [[nodiscard]] bool unified_memory() const {
    return number_of<cl_bool>(found_.device, CL_DEVICE_HOST_UNIFIED_MEMORY) == CL_TRUE;
  }

  [[nodiscard]] Memory make_memory(cl_mem_flags flags, std::size_t bytes, void* host, std::string_view operation) {
    cl_int code = CL_SUCCESS;
    Memory memory(clCreateBuffer(context_.get(), flags, bytes, host, &code));
    succeed(code, info_.id, operation, "clCreateBuffer");
    return memory;
  }

  /// Memory of the host in place; it lives until the driver needs it no more.
  [[nodiscard]] Memory over(std::shared_ptr<const PageBuffer> pages, cl_mem_flags access, std::string_view operation) {
    using Owner = std::shared_ptr<const PageBuffer>;
    auto owner = std::make_unique<Owner>(std::move(pages));
    Memory memory = make_memory(access | CL_MEM_USE_HOST_PTR, (*owner)->size(), (*owner)->data(), operation);
    const auto forget = [](cl_mem, void* owned) { const std::unique_ptr<Owner> last(static_cast<Owner*>(owned)); };
    succeed(clSetMemObjectDestructorCallback(memory.get(), forget, owner.get()), info_.id, operation,
            "clSetMemObjectDestructorCallback");
    static_cast<void>(owner.release());  // the callback's now
    return memory;
  }

  [[nodiscard]] std::string options_for(const Macros& macros) const {
    std::string options = fmt::format("-cl-std=CL1.2 -DWORKGROUP={} -DWIDTH={}", shape_.workgroup, shape_.width);
    for (const auto& [name, value] : macros) options += fmt::format(" -D{}={}", name, value);
    return options;
  }

  /// A file of kernels/cl/ with these options, compiled once.
  [[nodiscard]] cl_program program_of(const std::string& file, const std::string& options, std::string_view operation) {
    Program& program = programs_[file + ' ' + options];
    if (program == nullptr) {
      const cl_device_id device = found_.device;
      const CompileKey key{.backend = "opencl",
                           .device = text_of(device, CL_DEVICE_VENDOR) + '\n' + info_.name,
                           .driver = text_of(found_.platform, CL_PLATFORM_VERSION) + '\n' +
                                     text_of(device, CL_DEVICE_VERSION) + '\n' + text_of(device, CL_DRIVER_VERSION),
                           .options = options,
                           .source = kernel_source("cl", file + ".cl")};
      program = load_program(context_.get(), device, key, info_.id, operation);
    }
    return program.get();
  }

  /// Runs the kernel over nothing: drivers finish compiling at the first launch, and that shall not be the solver's.
  void warm_up(const Kernel& kernel) {
    const Timer timer;
    const Buffer dummy(64, make_memory(CL_MEM_READ_WRITE, 64, nullptr, "warm up"));
    std::array<const Buffer*, 8> buffers{};
    buffers.fill(&dummy);
    const std::vector<std::byte> arguments(kernel.line().argument_bytes);
    queue_.run(kernel, 1, std::span(buffers).first(kernel.line().access.size()), arguments, "Warm up");
    queue_.wait();
    add_compile_seconds(timer.seconds());
  }

  static constexpr std::size_t huge_page = std::size_t{1} << 20;
  Found found_;
  DeviceInfo info_;
  Shape shape_;
  Context context_;
  Queue queue_;
  std::map<std::string, Program> programs_;
  std::set<std::string> warm_;
};

DeviceType type_of(cl_device_id device) {
  const auto type = number_of<cl_device_type>(device, CL_DEVICE_TYPE);
  if ((type & CL_DEVICE_TYPE_CPU) != 0) return DeviceType::cpu;
  return (type & CL_DEVICE_TYPE_GPU) != 0 ? DeviceType::gpu : DeviceType::other;
}

/// INTERFLECT_OPENCL_SHAPE, "" where it is not set.
std::string_view forced_shape() {
  const char* forced = std::getenv("INTERFLECT_OPENCL_SHAPE");
  return forced == nullptr ? "" : forced;
}

Shape shape_of(cl_device_id device) {
  const std::string_view asked = forced_shape();
  const auto largest = number_of<std::size_t>(device, CL_DEVICE_MAX_WORK_GROUP_SIZE);
  const auto native = number_of<cl_uint>(device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT);
  const bool cpu = asked.empty() ? type_of(device) == DeviceType::cpu || largest < 64 : asked == "cpu";
  return {.workgroup = cpu ? 1 : std::bit_floor(std::clamp<std::size_t>(largest, 64, 256)),
          .width = std::bit_floor(std::clamp(native, 4U, 16U))};
}

/// What of the things that kernels/cl/ needs the device lacks, or what was wrongly asked for; empty: nothing.
std::string missing(cl_device_id device) {
  constexpr cl_device_fp_config arithmetic = CL_FP_ROUND_TO_NEAREST | CL_FP_INF_NAN;
  const std::string version = text_of(device, CL_DEVICE_VERSION);
  if (number_of<cl_bool>(device, CL_DEVICE_AVAILABLE) == CL_FALSE) return "the driver says that it is not available";
  if (version.starts_with("OpenCL 1.0") || version.starts_with("OpenCL 1.1")) return version + ", 1.2 is needed";
  if (number_of<cl_bool>(device, CL_DEVICE_COMPILER_AVAILABLE) == CL_FALSE) return "its driver has no compiler";
  if (number_of<cl_bool>(device, CL_DEVICE_ENDIAN_LITTLE) == CL_FALSE) return "it is not little-endian";
  if ((number_of<cl_device_fp_config>(device, CL_DEVICE_SINGLE_FP_CONFIG) & arithmetic) != arithmetic) {
    return "its fp32 arithmetic does not round to nearest or has no infinities and NaNs";
  }
  const std::string_view asked = forced_shape();
  if (!asked.empty() && asked != "cpu" && asked != "gpu") {
    return fmt::format("INTERFLECT_OPENCL_SHAPE: '{}' is neither cpu nor gpu", asked);
  }
  return "";
}

DeviceEntry describe(const Found& found, std::size_t index) {
  DeviceEntry entry;
  entry.reason = found.reason;
  DeviceInfo& info = entry.info;
  info.id = fmt::format("opencl:{}", index);
  info.backend = "opencl";
  if (found.platform != nullptr) info.driver = text_of(found.platform, CL_PLATFORM_NAME);
  if (found.device == nullptr) return entry;
  const cl_device_id device = found.device;
  info.name = text_of(device, CL_DEVICE_NAME);
  info.driver += ' ' + text_of(device, CL_DRIVER_VERSION);
  info.type = type_of(device);
  info.memory_bytes = number_of<cl_ulong>(device, CL_DEVICE_GLOBAL_MEM_SIZE);
  info.max_buffer_bytes = number_of<cl_ulong>(device, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
  info.compute_units = number_of<cl_uint>(device, CL_DEVICE_MAX_COMPUTE_UNITS);
  info.max_clock_mhz = number_of<cl_uint>(device, CL_DEVICE_MAX_CLOCK_FREQUENCY);
  if (info.type == DeviceType::gpu) info.hardware = uuid_of(device);
  const Shape shape = shape_of(device);
  info.max_groups = static_cast<std::uint32_t>(0xFFFFFFFFU / shape.workgroup);  // work-items counted in 32 bits
  info.rows_per_group = rows_per_group;
  info.blocks_per_group = shape.workgroup == 1 ? 16 : 1;
  entry.reason = missing(device);
  entry.available = entry.reason.empty();
  return entry;
}

}  // namespace

std::vector<DeviceEntry> list_devices() {
  std::vector<DeviceEntry> entries;
  for (const Found& found : find_devices()) entries.push_back(describe(found, entries.size()));
  return entries;
}

std::unique_ptr<interflect::Device> open_device(std::uint32_t index) {
  const std::vector<Found> all = find_devices();
  if (index >= all.size()) refuse(fmt::format("opencl:{}", index), "open", "there is no such device");
  const DeviceEntry entry = describe(all[index], index);
  if (!entry.available) refuse(entry.info.id, "open", entry.reason);
  return std::make_unique<Device>(all[index], entry.info, shape_of(all[index].device));
}

}  // namespace interflect::opencl
