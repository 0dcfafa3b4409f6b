#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "interflect/device/vulkan/api.h"

namespace interflect::vulkan {

/// Commands in order, in command buffers that are handed to the device one after the other: while one runs, the next is
/// recorded. All that throw, throw vk::SystemError.
class Commands {
 public:
  static constexpr std::size_t piece = std::size_t{16} << 20;  ///< bytes of staging memory for a command buffer

  /// ordered: with the barriers that let each command see what came before. Without them results are wrong; the tests
  /// of validation alone leave them out.
  Commands(std::shared_ptr<Context> context, bool ordered);
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;
  ~Commands();

  /// Takes one more command. So many make a submission, which no watchdog then waits for: next() hands them over
  /// itself.
  vk::CommandBuffer next();
  /// Hands over what is recorded.
  void submit();
  /// Returns when everything is done.
  void finish();

  /// Host memory into a buffer and back through staging memory. The bytes of `from` may be reused on return.
  void copy_in(std::span<const std::byte> from, vk::Buffer to, std::size_t offset);
  void copy_out(vk::Buffer from, std::size_t offset, std::span<std::byte> to);

 private:
  static constexpr std::uint32_t most_commands = 64;

  /// A command buffer, what tells when it is done, and memory for its transfers.
  struct Slot {
    vk::raii::CommandBuffer commands;
    vk::raii::Fence fence;
    Memory staging;
    bool under_way = false;
  };
  void finish(Slot& slot);
  Slot& with_staging();

  std::shared_ptr<Context> context_;
  bool ordered_;
  vk::raii::Queue queue_;
  vk::raii::CommandPool pool_;
  std::vector<Slot> slots_;
  std::size_t current_ = 0;
  std::uint32_t recorded_ = 0;  ///< in the current slot; 0: it is not being recorded
};

}  // namespace interflect::vulkan
