#include "interflect/device/vulkan/commands.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace interflect::vulkan {

namespace {

using Stage = vk::PipelineStageFlagBits;
using Access = vk::AccessFlagBits;

/// Kernels and copies: all that commands do here.
constexpr vk::PipelineStageFlags work = Stage::eComputeShader | Stage::eTransfer;
constexpr vk::AccessFlags writes = Access::eShaderWrite | Access::eTransferWrite;
constexpr vk::AccessFlags reads = Access::eShaderRead | Access::eTransferRead;

}  // namespace

Commands::Commands(std::shared_ptr<Context> context, bool ordered)
    : context_(std::move(context)),
      ordered_(ordered),
      queue_(context_->device.getQueue(context_->adapter.family, 0)),
      pool_(context_->device, {vk::CommandPoolCreateFlagBits::eResetCommandBuffer, context_->adapter.family}) {
  constexpr std::uint32_t count = 3;  // one is recorded, one waits, one runs
  const vk::CommandBufferAllocateInfo wanted(*pool_, vk::CommandBufferLevel::ePrimary, count);
  for (vk::raii::CommandBuffer& commands : vk::raii::CommandBuffers(context_->device, wanted)) {
    slots_.push_back({std::move(commands), vk::raii::Fence(context_->device, vk::FenceCreateInfo()), {}});
  }
}

Commands::~Commands() {
  try {
    finish();
  } catch (...) {  // a lost device: nothing runs any more
  }
}

vk::CommandBuffer Commands::next() {
  if (recorded_ >= most_commands) submit();
  Slot& slot = slots_[current_];
  if (recorded_ == 0) {
    finish(slot);
    slot.commands.begin({vk::CommandBufferUsageFlagBits::eOneTimeSubmit});
  }
  // All commands count as dependent, also two panels of one product: they write disjoint rows of y, but as far as
  // Vulkan is told, and its validation sees, the whole of it.
  if (ordered_) slot.commands.pipelineBarrier(work, work, {}, vk::MemoryBarrier(writes, reads | writes), {}, {});
  ++recorded_;
  return *slot.commands;
}

void Commands::submit() {
  if (recorded_ == 0) return;
  Slot& slot = slots_[current_];
  recorded_ = 0;  // whatever happens now, these commands are not recorded further
  slot.commands.pipelineBarrier(work, Stage::eHost, {}, vk::MemoryBarrier(writes, Access::eHostRead), {}, {});
  slot.commands.end();
  const vk::CommandBuffer commands = *slot.commands;
  queue_.submit(vk::SubmitInfo({}, {}, commands), *slot.fence);
  slot.under_way = true;
  current_ = (current_ + 1) % slots_.size();
}

void Commands::finish() {
  submit();
  for (Slot& slot : slots_) finish(slot);
}

void Commands::finish(Slot& slot) {
  if (!slot.under_way) return;
  static_cast<void>(context_->device.waitForFences(*slot.fence, true, UINT64_MAX));
  slot.under_way = false;
  context_->device.resetFences(*slot.fence);
}

/// The slot of the next command, with staging memory that nothing uses: transfers are handed over at once.
Commands::Slot& Commands::with_staging() {
  if (recorded_ >= most_commands) submit();
  Slot& slot = slots_[current_];
  finish(slot);
  if (slot.staging.mapped == nullptr) {
    using Usage = vk::BufferUsageFlagBits;
    slot.staging = allocate_memory(*context_, piece, Usage::eTransferSrc | Usage::eTransferDst, Place::staging);
  }
  return slot;
}

void Commands::copy_in(std::span<const std::byte> from, vk::Buffer to, std::size_t offset) {
  const auto& dispatch = *context_->device.getDispatcher();
  for (std::size_t done = 0; done < from.size(); done += piece) {
    const std::span<const std::byte> part = from.subspan(done, std::min(piece, from.size() - done));
    const Slot& slot = with_staging();
    std::memcpy(slot.staging.mapped, part.data(), part.size());
    next().copyBuffer(*slot.staging.buffer, to, vk::BufferCopy(0, offset + done, part.size()), dispatch);
    submit();
  }
}

void Commands::copy_out(vk::Buffer from, std::size_t offset, std::span<std::byte> to) {
  const auto& dispatch = *context_->device.getDispatcher();
  for (std::size_t done = 0; done < to.size(); done += piece) {
    const std::span<std::byte> part = to.subspan(done, std::min(piece, to.size() - done));
    Slot& slot = with_staging();
    next().copyBuffer(from, *slot.staging.buffer, vk::BufferCopy(offset + done, 0, part.size()), dispatch);
    submit();
    finish(slot);
    std::memcpy(part.data(), slot.staging.mapped, part.size());
  }
}

}  // namespace interflect::vulkan
