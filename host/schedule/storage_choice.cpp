#include "interflect/schedule/storage_choice.h"

#include <fmt/format.h>

#include <algorithm>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/device/tuning.h"
#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

namespace {

constexpr std::uint32_t beyond_caches = 4096;         // patches: 64 MiB of dense32
constexpr std::uint64_t vector_bytes_of_patch = 256;  // 16 vectors of 3 columns, and some

/// Whether the partial sums of sym16, for three columns and the default block, fit one buffer of the device.
bool sym16_fits(std::uint32_t n, const DeviceInfo& device) {
  const std::uint64_t block = device.type == DeviceType::cpu ? 1024 : default_block_of_gpus;
  const std::uint64_t partial = std::uint64_t{n} * ((n + block - 1) / block) * 3 * sizeof(float);
  return device.max_buffer_bytes == 0 || partial <= device.max_buffer_bytes;
}

}  // namespace

std::optional<Storage> storage_of(std::string_view text) {
  if (text == "auto") return std::nullopt;
  for (const Storage storage : {Storage::dense32, Storage::dense16, Storage::tiled16, Storage::sym16}) {
    if (text == name(storage)) return storage;
  }
  throw Error(ErrorKind::usage, fmt::format("storage '{}' is none of auto, dense32, dense16, tiled16, sym16", text));
}

Storage choose_storage(std::uint32_t n, const DeviceInfo& device) {
  const bool in_place = device.type == DeviceType::cpu && !device.emulated();
  std::uint64_t available = device.memory_bytes;  // 0: not known
  if (device.type == DeviceType::cpu && available != 0) available = std::min(available, available_memory());
  const std::uint64_t needed =
      (in_place ? 0 : FormFactorMatrix::predicted_bytes(n)) + std::uint64_t{n} * vector_bytes_of_patch;
  const bool too_large = available != 0 && needed > available;
  if (!too_large && !(device.emulated() && n >= beyond_caches)) return Storage::dense32;
  return sym16_fits(n, device) ? Storage::sym16 : Storage::tiled16;
}

Storage choose_storage(std::uint32_t n, std::span<const DeviceInfo> devices) {
  if (devices.size() == 1) return choose_storage(n, devices.front());
  const std::uint64_t needed = FormFactorMatrix::predicted_bytes(n), vectors = std::uint64_t{n} * vector_bytes_of_patch;
  std::uint64_t room = 0, on_the_host = 0;
  bool all_of_it = false, sym16 = true;
  for (const DeviceInfo& device : devices) {
    const bool in_place = device.type == DeviceType::cpu && !device.emulated();
    all_of_it = all_of_it || in_place || device.memory_bytes == 0;
    const std::uint64_t has = device.memory_bytes > vectors ? device.memory_bytes - vectors : 0;
    if (device.type != DeviceType::cpu) room += has;
    if (device.type == DeviceType::cpu) on_the_host = std::max(on_the_host, std::min(has, available_memory()));
    sym16 = sym16 && sym16_fits(n, device);
  }
  if (all_of_it || room + on_the_host >= needed) return Storage::dense32;
  return sym16 ? Storage::sym16 : Storage::tiled16;
}

std::uint32_t sym16_block(const DeviceInfo& device, std::uint32_t n) {
  if (const std::uint32_t tuned = preferred_block(&device, n); tuned != 0) return tuned;
  return device.type == DeviceType::cpu ? 0 : default_block_of_gpus;
}

}  // namespace interflect
