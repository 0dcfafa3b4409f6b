#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <vector>

#include "device/cuda_on_cpu.h"
#include "device/fake_cuda/fake_cuda.h"
#include "interflect/device/cuda/api.h"

// What the fake driver knows, for its two files: fake_driver.cpp (devices, contexts, memory, streams, transfers) and
// fake_launches.cpp (modules, launches, graphs).

namespace interflect::fake_cuda {

using cuda::DevicePointer;
using cuda::Result;
using cuda::Uuid;

// CUresult, as documented.
inline constexpr Result invalid_value = 1, no_memory = 2, no_device = 100, invalid_device = 101, invalid_image = 200,
                        invalid_context = 201, wrong_architecture = 209, invalid_handle = 400, not_found = 500,
                        launch_failed = 719, unknown = 999;

// A device pointer is an address that the host cannot use.
inline constexpr DevicePointer device_bit = DevicePointer{1} << 60U;
inline constexpr std::size_t device_bytes = std::size_t{1} << 30U;
inline constexpr int capability = 90;

struct Free {
  void operator()(std::byte* p) const { ::operator delete[](p, std::align_val_t{256}); }
};
struct Memory {
  std::unique_ptr<std::byte[], Free> bytes;
  std::size_t size = 0;
};
inline Memory allocate(std::size_t size) {
  Memory memory{std::unique_ptr<std::byte[], Free>(new (std::align_val_t{256}) std::byte[size]), size};
  std::memset(memory.bytes.get(), 0xA5, size);  // rubbish
  return memory;
}

struct Stream {
  std::deque<std::function<Result()>> work;
  Result failed = 0;
};
struct Event {
  Stream* stream = nullptr;
  int recorded = 0, passed = 0;  ///< how many times
};
struct Function {
  const cuda_on_cpu::Compiled* compiled = nullptr;
};
struct Module {
  std::map<std::string, int> macros;
  std::vector<std::unique_ptr<Function>> functions;
};
/// A launch, its parameters copied: device pointers and the argument block.
struct Work {
  const Function* function = nullptr;
  unsigned grid = 0;
  std::vector<DevicePointer> pointers;
  std::vector<std::byte> block;
};
struct Node {
  Work work;
  std::vector<const Node*> after;
};
struct Graph {
  std::vector<std::unique_ptr<Node>> nodes;
};
struct GraphExec {
  std::vector<Work> work;  ///< in an order that the graph allows
  int running = 0;         ///< launches of it that are in a stream
};

inline int number(const char* variable, int otherwise) {
  const char* value = std::getenv(variable);
  return value == nullptr ? otherwise : std::atoi(value);
}

class Fake {
 public:
  Fake() { fail(number("FAKE_CUDA_FAIL", 0), unknown, number("FAKE_CUDA_LOST", 0) != 0); }
  ~Fake() {
    const char* path = std::getenv("FAKE_CUDA_REPORT");
    if (path == nullptr) return;
    if (std::FILE* file = std::fopen(path, "w")) {
      std::fputs(report().c_str(), file);
      std::fclose(file);
    }
  }

  void fail(int call, Result code, bool lost) {
    failing_ = call;
    code_ = code;
    lost_ = lost;
  }
  void reset() {
    calls = kernels = graph_launches = 0;
    broken_rules.clear();
    fail(0, unknown, false);
  }

  /// Counts a call; what it must return without doing anything, or 0.
  Result count() {
    ++calls;
    return failing_ != 0 && (calls == failing_ || (lost_ && calls > failing_)) ? code_ : 0;
  }
  /// As count(), for calls that need a current context.
  Result enter() {
    const Result result = count();
    if (result == 0 && current == nullptr) return broke("a call without a current context", invalid_context);
    return result;
  }
  Result broke(const std::string& rule, Result result) {
    broken_rules.push_back(rule);
    return result;
  }

  /// The host's address of device memory [at, at + size); null when it is not all of one allocation.
  std::byte* host(DevicePointer at, std::size_t size) {
    const auto after = memory.upper_bound(at);
    if (after == memory.begin()) return nullptr;
    const auto& [start, block] = *std::prev(after);
    if (at - start > block.size || size > block.size - (at - start)) return nullptr;
    return block.bytes.get() + (at - start);
  }
  bool is_pinned(const void* at, std::size_t size) const {
    for (const auto& [start, block] : pinned) {
      const auto* byte = static_cast<const std::byte*>(at);
      if (byte >= block.bytes.get() && byte + size <= block.bytes.get() + block.size) return true;
    }
    return false;
  }

  Result drain(Stream& stream, std::size_t keep = 0) {
    while (stream.work.size() > keep) {
      const auto work = std::move(stream.work.front());
      stream.work.pop_front();
      if (stream.failed == 0) stream.failed = work();
    }
    return stream.failed;
  }
  void drain_all() {
    for (auto& [key, stream] : streams) (void)drain(*stream);
  }

  std::string report() const {
    const std::size_t live = memory.size() + pinned.size() + streams.size() + events.size() + modules.size() +
                             graphs.size() + executables.size() + static_cast<std::size_t>(contexts);
    std::string text = "calls=" + std::to_string(calls) + " kernels=" + std::to_string(kernels) +
                       " graphs=" + std::to_string(graph_launches) + " live=" + std::to_string(live) + "\n";
    const auto line = [&](const char* what, std::size_t count) {
      if (count != 0) text += "live: " + std::to_string(count) + " " + what + "\n";
    };
    line("device memory", memory.size());
    line("pinned memory", pinned.size());
    line("streams", streams.size());
    line("events", events.size());
    line("modules", modules.size());
    line("graphs", graphs.size());
    line("executable graphs", executables.size());
    line("contexts", static_cast<std::size_t>(contexts));
    for (const std::string& rule : broken_rules) text += "broken: " + rule + "\n";
    return text;
  }

  std::mutex mutex;
  int devices = number("FAKE_CUDA_DEVICES", 1);
  int calls = 0, kernels = 0, graph_launches = 0, contexts = 0;
  static thread_local void* current;
  std::map<DevicePointer, Memory> memory;
  std::map<const void*, Memory> pinned;
  std::map<const void*, std::unique_ptr<Stream>> streams;
  std::map<const void*, std::unique_ptr<Event>> events;
  std::map<const void*, std::unique_ptr<Module>> modules;
  std::map<const void*, std::unique_ptr<Graph>> graphs;
  std::map<const void*, std::unique_ptr<GraphExec>> executables;
  std::vector<std::string> broken_rules;

 private:
  int failing_ = 0;
  Result code_ = unknown;
  bool lost_ = false;
};
Fake& fake();

/// The object of that handle; null and a broken rule when there is none.
template <class T>
T* find(std::map<const void*, std::unique_ptr<T>>& all, const void* handle, const char* what) {
  const auto found = all.find(handle);
  if (found != all.end()) return found->second.get();
  fake().broken_rules.push_back(std::string("a ") + what + " that does not exist");
  return nullptr;
}
template <class T>
T* add(std::map<const void*, std::unique_ptr<T>>& all) {
  auto object = std::make_unique<T>();
  T* raw = object.get();
  all.emplace(raw, std::move(object));
  return raw;
}

}  // namespace interflect::fake_cuda

// NOLINTNEXTLINE(bugprone-macro-parentheses): the caller's return
#define FAKE_ENTER(counted)                 \
  const std::lock_guard lock(fake().mutex); \
  if (const Result result = (counted); result != 0) return result
