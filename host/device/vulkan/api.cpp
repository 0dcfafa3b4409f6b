#include "interflect/device/vulkan/api.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <utility>

namespace interflect::vulkan {

std::string text(vk::Result result) {
  const std::string name = vk::to_string(result);  // "ErrorDeviceLost"
  std::string out = "VK";
  bool before = false;  // whether the letter before was a capital
  for (const char c : name) {
    const bool capital = std::isupper(static_cast<unsigned char>(c)) != 0;
    if (capital && !before) out += '_';
    out += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    before = capital;
  }
  return fmt::format("{} ({})", out, static_cast<int>(result));
}

std::string_view variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

std::string text(const vk::SystemError& error) {
  return text(static_cast<vk::Result>(error.code().value()));
}

Messages& Messages::all() {
  static Messages messages;
  return messages;
}

void Messages::add(std::string message) {
  const std::lock_guard lock(mutex_);
  said_.push_back(std::move(message));
}

std::vector<std::string> Messages::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(said_, {});
}

void Messages::raise(std::string_view device, std::string_view operation) {
  const std::vector<std::string> said = take();
  if (said.empty()) return;
  refuse(device, operation, fmt::format("the validation layer reports, first of {}: {}", said.size(), said.front()));
}

namespace {

constexpr const char* validation_layer = "VK_LAYER_KHRONOS_validation";

bool validation_wanted() {
  const std::string_view value = variable("INTERFLECT_VULKAN_VALIDATION");
  if (value.empty() || value == "0") return false;
  if (value != "1") throw fmt::format("INTERFLECT_VULKAN_VALIDATION: '{}' is neither 0 nor 1", value);
  return true;
}

VKAPI_ATTR VkBool32 VKAPI_CALL note_message(VkDebugUtilsMessageSeverityFlagBitsEXT, VkDebugUtilsMessageTypeFlagsEXT,
                                            const VkDebugUtilsMessengerCallbackDataEXT* data, void* messages) {
  static_cast<Messages*>(messages)->add(data->pMessage);
  return VK_FALSE;
}

/// Whether the driver's extensions have this one.
bool has_extension(const vk::raii::PhysicalDevice& physical, std::string_view name) {
  const auto all = physical.enumerateDeviceExtensionProperties();
  return std::any_of(all.begin(), all.end(), [&](const auto& e) { return name == e.extensionName.data(); });
}

}  // namespace

Instance::Instance() : context_(::vkGetInstanceProcAddr) {
  const vk::ApplicationInfo application("Interflect", 0, nullptr, 0, VK_API_VERSION_1_3);
  vk::InstanceCreateInfo create({}, &application);
  if (!validation_wanted()) {
    instance_ = vk::raii::Instance(context_, create);
    return;
  }
  const auto layers = context_.enumerateInstanceLayerProperties();
  if (std::none_of(layers.begin(), layers.end(),
                   [](const auto& l) { return std::strcmp(l.layerName, validation_layer) == 0; })) {
    throw fmt::format("INTERFLECT_VULKAN_VALIDATION: the layer {} is not installed", validation_layer);
  }
  using Severity = vk::DebugUtilsMessageSeverityFlagBitsEXT;
  using Type = vk::DebugUtilsMessageTypeFlagBitsEXT;
  const vk::ValidationFeatureEnableEXT features[] = {vk::ValidationFeatureEnableEXT::eSynchronizationValidation};
  const vk::ValidationFeaturesEXT validation(features);
  const vk::DebugUtilsMessengerCreateInfoEXT messenger({}, Severity::eWarning | Severity::eError,
                                                       Type::eValidation | Type::ePerformance, &note_message,
                                                       &Messages::all(), &validation);
  const char* const extensions[] = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME, VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME};
  create.setPEnabledLayerNames(validation_layer).setPEnabledExtensionNames(extensions);
  create.setPNext(&messenger);  // also for what happens while the instance is made and destroyed
  instance_ = vk::raii::Instance(context_, create);
  messenger_ =
      vk::raii::DebugUtilsMessengerEXT(instance_, vk::DebugUtilsMessengerCreateInfoEXT(messenger).setPNext(nullptr));
}

namespace {

std::string hexadecimal(const std::uint8_t* bytes, std::size_t count) {
  std::string out;
  for (std::size_t i = 0; i < count; ++i) out += fmt::format("{:02x}", bytes[i]);
  return out;
}

std::string version_text(std::uint32_t version) {
  return fmt::format("{}.{}.{}", VK_API_VERSION_MAJOR(version), VK_API_VERSION_MINOR(version),
                     VK_API_VERSION_PATCH(version));
}

/// What version 1.1 and, where it is there, more tells of a device.
void read_properties(Adapter& adapter) {
  const std::uint32_t version = adapter.properties.apiVersion;
  vk::PhysicalDeviceIDProperties identity;
  vk::PhysicalDeviceMaintenance3Properties allocation;
  vk::PhysicalDeviceDriverProperties driver;
  vk::PhysicalDeviceSubgroupSizeControlProperties sizes;
  vk::PhysicalDeviceSubgroupSizeControlFeatures control;
  vk::PhysicalDeviceProperties2 properties;
  vk::PhysicalDeviceFeatures2 features;
  const bool names_driver = version >= VK_API_VERSION_1_2;
  const bool sizes_known =
      version >= VK_API_VERSION_1_3 || has_extension(adapter.physical, VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME);
  properties.pNext = &identity;
  identity.pNext = &allocation;
  allocation.pNext = &adapter.subgroup;
  if (sizes_known) adapter.subgroup.pNext = &sizes;
  if (names_driver) driver.pNext = std::exchange(properties.pNext, &driver);
  if (sizes_known) features.pNext = &control;
  const auto& dispatch = *adapter.physical.getDispatcher();
  dispatch.vkGetPhysicalDeviceProperties2(*adapter.physical,
                                          reinterpret_cast<VkPhysicalDeviceProperties2*>(&properties));
  dispatch.vkGetPhysicalDeviceFeatures2(*adapter.physical, reinterpret_cast<VkPhysicalDeviceFeatures2*>(&features));
  adapter.subgroup.pNext = nullptr;
  adapter.max_allocation = allocation.maxMemoryAllocationSize;
  adapter.uuid = hexadecimal(identity.deviceUUID, identity.deviceUUID.size());
  adapter.driver = names_driver ? fmt::format("{} {}", driver.driverName.data(), driver.driverInfo.data())
                                : version_text(adapter.properties.driverVersion);
  const bool compute = static_cast<bool>(sizes.requiredSubgroupSizeStages & vk::ShaderStageFlagBits::eCompute);
  if (sizes_known && control.subgroupSizeControl && compute) {
    adapter.smallest_subgroup = sizes.minSubgroupSize;
    adapter.largest_subgroup = sizes.maxSubgroupSize;
  }
}

std::optional<std::uint32_t> compute_family(const vk::raii::PhysicalDevice& physical) {
  const auto families = physical.getQueueFamilyProperties();
  const auto found = std::find_if(families.begin(), families.end(), [](const vk::QueueFamilyProperties& family) {
    return static_cast<bool>(family.queueFlags & vk::QueueFlagBits::eCompute);
  });
  if (found == families.end()) return std::nullopt;
  return static_cast<std::uint32_t>(found - families.begin());
}

}  // namespace

std::vector<Adapter> adapters(const Instance& instance) {
  std::vector<Adapter> all;
  for (vk::raii::PhysicalDevice& physical : vk::raii::PhysicalDevices(instance.get())) {
    Adapter adapter;
    adapter.physical = std::move(physical);
    adapter.properties = adapter.physical.getProperties();
    const std::uint32_t version = adapter.properties.apiVersion;
    if (version < VK_API_VERSION_1_1) {
      adapter.driver = version_text(adapter.properties.driverVersion);
      adapter.reason = fmt::format("the device has Vulkan {}, 1.1 is needed", version_text(version));
    } else if (const auto family = compute_family(adapter.physical)) {
      adapter.family = *family;
      read_properties(adapter);
      try {
        adapter.shape = choose_shape(adapter);
        adapter.reason = missing_limit(adapter);
      } catch (const std::string& cause) {
        adapter.reason = cause;
      }
    } else {
      adapter.reason = "the device has no queue that computes";
    }
    all.push_back(std::move(adapter));
  }
  return all;
}

std::shared_ptr<Context> open_context(std::uint32_t index) {
  const std::string id = fmt::format("vulkan:{}", index);
  auto instance = attempt(id, "open", [] { return std::make_shared<Instance>(); });
  std::vector<Adapter> all = attempt(id, "open", [&] { return adapters(*instance); });
  if (index >= all.size()) refuse(id, "open", "there is no such device");
  Adapter adapter = std::move(all[index]);
  if (!adapter.reason.empty()) refuse(id, "open", adapter.reason);
  const float priority = 1;
  const vk::DeviceQueueCreateInfo queue({}, adapter.family, 1, &priority);
  vk::DeviceCreateInfo create({}, queue);
  vk::PhysicalDeviceSubgroupSizeControlFeatures control(true);
  const char* const extension = VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME;
  if (adapter.shape.subgroup != 0) {
    create.setPNext(&control);
    if (adapter.properties.apiVersion < VK_API_VERSION_1_3) create.setPEnabledExtensionNames(extension);
  }
  return attempt(id, "open", [&] {
    vk::raii::Device device(adapter.physical, create);
    const auto memory = adapter.physical.getMemoryProperties();
    return std::make_shared<Context>(Context{id, std::move(instance), std::move(adapter), std::move(device), memory});
  });
}

namespace {

/// The first memory type of those allowed that has the most wanted flags; `needed` it must have.
std::optional<std::uint32_t> memory_type(const vk::PhysicalDeviceMemoryProperties& memory, std::uint32_t allowed,
                                         vk::MemoryPropertyFlags needed, vk::MemoryPropertyFlags wanted) {
  std::optional<std::uint32_t> best;
  int most = -1;
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    const vk::MemoryPropertyFlags flags = memory.memoryTypes[i].propertyFlags;
    if ((allowed >> i & 1U) == 0 || (flags & needed) != needed) continue;
    const int count = __builtin_popcount(static_cast<std::uint32_t>(flags & wanted));
    if (count > most) best = i;
    most = std::max(most, count);
  }
  return best;
}

}  // namespace

Memory allocate_memory(const Context& context, std::size_t bytes, vk::BufferUsageFlags usage, Place place) {
  using Flag = vk::MemoryPropertyFlagBits;
  Memory made;
  made.buffer = vk::raii::Buffer(context.device, vk::BufferCreateInfo({}, bytes, usage));
  const vk::MemoryRequirements needs = made.buffer.getMemoryRequirements();
  const bool seen = place != Place::device;
  const vk::MemoryPropertyFlags needed =
      seen ? Flag::eHostVisible | Flag::eHostCoherent : vk::MemoryPropertyFlags(Flag::eDeviceLocal);
  const vk::MemoryPropertyFlags wanted =
      place == Place::shared ? Flag::eDeviceLocal | Flag::eHostCached : vk::MemoryPropertyFlags(Flag::eHostCached);
  const auto type =
      memory_type(context.memory, needs.memoryTypeBits, needed, seen ? wanted : vk::MemoryPropertyFlags());
  if (!type) throw vk::FeatureNotPresentError("no memory of that kind");
  made.memory = vk::raii::DeviceMemory(context.device, vk::MemoryAllocateInfo(needs.size, *type));
  made.buffer.bindMemory(*made.memory, 0);
  if (seen) made.mapped = static_cast<std::byte*>(made.memory.mapMemory(0, VK_WHOLE_SIZE));
  return made;
}

}  // namespace interflect::vulkan
