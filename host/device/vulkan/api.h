#pragma once

#define VULKAN_HPP_ENABLE_DYNAMIC_LOADER_TOOL 0  // the loader is linked
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>
#include <vulkan/vulkan_raii.hpp>

#include "interflect/device/device.h"
#include "interflect/device/kernel_table.h"

// What surrounds the Vulkan API: errors as text, the instance with its validation, the devices it sees, memory. Of the
// backend alone: no other header includes it.

namespace interflect::vulkan {

/// "VK_ERROR_DEVICE_LOST (-4)".
[[nodiscard]] std::string text(vk::Result result);
[[nodiscard]] std::string text(const vk::SystemError& error);

/// A variable of the environment; empty: it is not set.
[[nodiscard]] std::string_view variable(const char* name);

/// What f() gives; an error of the API becomes the device Error "DEVICE: OPERATION: VK_ERROR_... (code)", a plain
/// std::string "DEVICE: OPERATION: STRING".
template <class F>
decltype(auto) attempt(std::string_view device, std::string_view operation, F&& f) {
  try {
    return f();
  } catch (const vk::SystemError& error) {
    refuse(device, operation, text(error));
  } catch (const std::string& cause) {
    refuse(device, operation, cause);
  }
}

/// What the validation layer has said in this process, also while devices and instances were destroyed.
class Messages {
 public:
  /// The one record; outlives every Instance.
  [[nodiscard]] static Messages& all();
  void add(std::string message);
  /// What was said and neither taken nor raised yet.
  [[nodiscard]] std::vector<std::string> take();
  /// Throws a device Error with what take() gives, if anything.
  void raise(std::string_view device, std::string_view operation);

 private:
  std::mutex mutex_;
  std::vector<std::string> said_;
};

/// The loader's instance; with INTERFLECT_VULKAN_VALIDATION=1 under the validation layer.
class Instance {
 public:
  /// Throws vk::SystemError, or a plain std::string, the cause, for validation that cannot be had.
  Instance();
  [[nodiscard]] const vk::raii::Instance& get() const { return instance_; }

 private:
  vk::raii::Context context_;
  vk::raii::Instance instance_ = nullptr;
  vk::raii::DebugUtilsMessengerEXT messenger_ = nullptr;
};

/// How kernels are cut and memory is used on a device.
struct Shape {
  bool texel = false;           ///< what is read by fours is bound as a texel buffer
  bool staged = false;          ///< memory that the host cannot see
  std::uint32_t workgroup = 0;  ///< invocations of a work-group
  std::uint32_t rows = 0;       ///< of matvec, for a work-group
  std::uint32_t chunk = 0;      ///< columns of matvec, at most, for a work-group
  std::uint32_t subgroup = 0;   ///< the size that is asked for; 0: none is
  std::uint32_t subgroups = 0;  ///< of a work-group, at most; 0: subgroups cannot add
  bool shuffles = false;        ///< a work-group is one subgroup, whose invocations can exchange values
};

/// A device as it is before it is opened.
struct Adapter {
  vk::raii::PhysicalDevice physical = nullptr;
  vk::PhysicalDeviceProperties properties;
  vk::PhysicalDeviceSubgroupProperties subgroup;
  std::uint32_t family = 0;  ///< of queues that compute
  /// The subgroup sizes that can be asked for; 0: none can.
  std::uint32_t smallest_subgroup = 0, largest_subgroup = 0;
  std::uint64_t max_allocation = 0;  ///< bytes of one piece of memory
  std::string driver, uuid, reason;  ///< reason: why it cannot be used; empty: it can
  Shape shape;                       ///< of a device that can be used
};
[[nodiscard]] std::vector<Adapter> adapters(const Instance& instance);

/// Columns of sym16, at most, for a work-group: no more fit into 16 KiB of shared memory, which every device has.
inline constexpr std::uint32_t sym16_chunk = 3;

/// From the device's properties and the environment. Throws a plain std::string, the cause, for a wrong environment.
[[nodiscard]] Shape choose_shape(const Adapter& adapter);
/// The first limit of the device that is too low for the kernels in its shape, in words; empty: there is none.
[[nodiscard]] std::string missing_limit(const Adapter& adapter);

/// An opened device, shared by all that is made on it.
struct Context {
  std::string id;
  std::shared_ptr<Instance> instance;
  Adapter adapter;
  vk::raii::Device device = nullptr;
  vk::PhysicalDeviceMemoryProperties memory;
};
/// Of list_devices()[index]. Throws a device Error.
[[nodiscard]] std::shared_ptr<Context> open_context(std::uint32_t index);

/// A buffer of the API with its memory.
struct Memory {
  vk::raii::DeviceMemory memory = nullptr;
  vk::raii::Buffer buffer = nullptr;
  std::byte* mapped = nullptr;  ///< where the host sees it; null: it does not
};
/// Where only the device sees it; where both do; where the host sees it best.
enum class Place { device, shared, staging };
[[nodiscard]] Memory allocate_memory(const Context& context, std::size_t bytes, vk::BufferUsageFlags usage,
                                     Place place);

/// What open_device() of vulkan.h makes of a context; also without the barriers between launches: for the test that
/// shows that validation reports their absence.
[[nodiscard]] std::unique_ptr<interflect::Device> open_device(std::shared_ptr<Context> context, bool ordered);

}  // namespace interflect::vulkan
