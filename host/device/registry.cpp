#include "interflect/device/registry.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/cuda/cuda.h"
#include "interflect/device/opencl/opencl.h"
#include "interflect/device/openmp/openmp.h"
#include "interflect/device/vulkan/vulkan.h"

// The only file that names all backends. A new one is a line of all_backends().

namespace interflect {

namespace {

/// In the order in which `auto` prefers them.
const Registry& all_backends() {
  static const Registry registry({
      {"cuda", &cuda::list_devices, &cuda::open_device},
      {"opencl", &opencl::list_devices, &opencl::open_device},
      {"vulkan", &vulkan::list_devices, &vulkan::open_device},
      {"openmp", &openmp::list_devices, &openmp::open_device},
  });
  return registry;
}

/// What the backend lists; a backend that fails is one entry that says why.
std::vector<DeviceEntry> entries_of(const Backend& backend) {
  try {
    return backend.list();
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::device) throw;  // INTERFLECT_SIMD has a wrong value, for one
    DeviceInfo info;
    info.id = info.backend = backend.name;
    return {{.info = std::move(info), .available = false, .reason = error.what()}};
  }
}

/// Several devices of one piece of hardware, the preferred one first.
struct Piece {
  std::vector<const DeviceEntry*> devices;
  double rate = 0;
};

std::vector<Piece> pieces_of(std::span<const DeviceEntry> entries) {
  std::vector<Piece> pieces;
  for (const DeviceEntry& entry : entries) {
    if (!entry.available || entry.info.type == DeviceType::cpu) continue;
    const auto same = std::find_if(pieces.begin(), pieces.end(), [&](const Piece& piece) {
      return !entry.info.hardware.empty() && piece.devices.front()->info.hardware == entry.info.hardware;
    });
    if (same != pieces.end()) {
      same->devices.push_back(&entry);
    } else {
      pieces.push_back({{&entry}, 0});
    }
  }
  return pieces;
}

}  // namespace

std::vector<std::string> rank_devices(std::span<const DeviceEntry> entries,
                                      const std::function<double(const DeviceEntry&)>& rate) {
  std::vector<Piece> pieces = pieces_of(entries);
  if (pieces.size() > 1) {
    for (Piece& piece : pieces) {
      for (std::size_t k = 0; k < piece.devices.size() && !(piece.rate > 0); ++k) piece.rate = rate(*piece.devices[k]);
    }
    std::stable_sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return a.rate > b.rate; });
  }
  std::vector<std::string> ids;
  for (const Piece& piece : pieces) {
    for (const DeviceEntry* entry : piece.devices) ids.push_back(entry->info.id);
  }
  for (const DeviceEntry& entry : entries) {
    if (entry.available && entry.info.type == DeviceType::cpu && !entry.info.emulated()) ids.push_back(entry.info.id);
  }
  return ids;
}

std::vector<std::string> all_devices(std::span<const DeviceEntry> entries,
                                     const std::function<double(const DeviceEntry&)>& rate) {
  std::vector<std::string> ids = rank_devices(entries, rate);
  for (const Piece& piece : pieces_of(entries)) {
    for (std::size_t k = 1; k < piece.devices.size(); ++k) std::erase(ids, piece.devices[k]->info.id);
  }
  return ids;
}

std::vector<DeviceEntry> Registry::list() const {
  std::vector<DeviceEntry> all;
  for (const Backend& backend : backends_) {
    for (DeviceEntry& entry : entries_of(backend)) all.push_back(std::move(entry));
  }
  return all;
}

const Backend* Registry::backend_of(std::string_view id) const {
  const std::string_view asked = id.substr(0, id.find(':'));
  const auto found =
      std::find_if(backends_.begin(), backends_.end(), [&](const Backend& backend) { return backend.name == asked; });
  return found == backends_.end() ? nullptr : &*found;
}

bool Registry::knows(std::string_view id) const {
  const Backend* backend = backend_of(id);
  if (backend == nullptr) return false;
  const std::vector<DeviceEntry> entries = entries_of(*backend);
  return std::any_of(entries.begin(), entries.end(), [&](const DeviceEntry& entry) { return entry.info.id == id; });
}

void Registry::refuse_unknown(std::string_view id) const {
  std::vector<std::string> valid = {"auto", "all"}, missing;
  for (const DeviceEntry& entry : list()) {
    if (entry.available) {
      valid.push_back(entry.info.id);
    } else {
      missing.push_back(fmt::format("{}: {}", entry.info.id, entry.reason));
    }
  }
  std::string message = fmt::format("no device '{}'; there are {}", id, fmt::join(valid, ", "));
  if (!missing.empty()) message += fmt::format(" (not available: {})", fmt::join(missing, "; "));
  throw Error(ErrorKind::usage, message);
}

std::unique_ptr<Device> Registry::open(std::string_view id) const {
  if (id == "auto") {
    const std::vector<std::string> candidates = choose(id);
    for (std::size_t k = 0; k + 1 < candidates.size(); ++k) {
      try {
        return open(candidates[k]);
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::device) throw;
      }
    }
    return open(candidates.back());
  }
  const Backend* backend = backend_of(id);
  if (backend == nullptr) refuse_unknown(id);
  std::uint32_t index = 0;
  for (const DeviceEntry& entry : entries_of(*backend)) {
    if (entry.info.id == id && !entry.available) throw device_error(id, "open", entry.reason);
    if (entry.info.id == id) return backend->open(index);
    ++index;
  }
  refuse_unknown(id);
}

std::vector<std::string> Registry::choose(std::string_view text) const {
  if (text == "auto" || text == "all") {
    const std::vector<DeviceEntry> entries = list();
    const auto ranked = text == "auto" ? rank_devices : all_devices;
    std::vector<std::string> ids = ranked(entries, [&](const DeviceEntry& entry) {
      try {
        const Rate rate = quick_read_bandwidth(*open(entry.info.id));
        return rate.verified ? rate.gb_per_s() : 0.0;
      } catch (const Error&) {
        return 0.0;  // it goes to the end; whoever uses it hears why
      }
    });
    if (ids.empty()) throw device_error(text, "choose", "no device is available");
    return ids;
  }
  std::vector<std::string> ids;
  for (std::size_t first = 0; first <= text.size();) {
    const std::size_t comma = std::min(text.find(',', first), text.size());
    std::string id(text.substr(first, comma - first));
    first = comma + 1;
    if (std::find(ids.begin(), ids.end(), id) != ids.end()) {
      throw Error(ErrorKind::usage, fmt::format("the device '{}' is named twice in '{}'", id, text));
    }
    if (id == "auto" || id == "all") {
      throw Error(ErrorKind::usage, fmt::format("'{}' stands alone, not in a list as '{}'", id, text));
    }
    if (!knows(id)) refuse_unknown(id);
    ids.push_back(std::move(id));
  }
  return ids;
}

std::vector<DeviceEntry> list_devices() {
  return all_backends().list();
}

std::unique_ptr<Device> open_device(std::string_view id) {
  return all_backends().open(id);
}

std::vector<std::string> choose_devices(std::string_view text) {
  return all_backends().choose(text);
}

}  // namespace interflect
