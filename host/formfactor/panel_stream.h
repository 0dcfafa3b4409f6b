#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "interflect/base/memory.h"
#include "interflect/formfactor/exchange_panels.h"

namespace interflect {

/// Passes over panels of which memory holds a part. The first ones stay once they are read; the others come through a
/// few buffers, each read while the caller works on the one before. Every other pass goes backwards, so that it begins
/// with what the buffers, and the system's cache of the file, still hold. One thread at a time may use it.
class PanelStream {
 public:
  /// `memory` bytes for panels that stay and buffers. Nothing is read yet. The panels must outlive the stream.
  /// Throws a limit Error where not even two buffers fit.
  PanelStream(const ExchangePanels& panels, std::uint64_t memory);
  PanelStream(const PanelStream&) = delete;
  PanelStream& operator=(const PanelStream&) = delete;
  ~PanelStream() = default;

  [[nodiscard]] const ExchangePanels& panels() const { return panels_; }
  [[nodiscard]] std::uint64_t panel_bytes() const;  ///< of a whole panel
  [[nodiscard]] std::uint64_t bytes() const;        ///< of all panels

  /// How many panels fit the memory beside the buffers.
  [[nodiscard]] std::uint32_t fitting() const { return fitting_; }
  /// How many panels, the first ones, stay in memory from now on: at most fitting(), which is also the default. For a
  /// caller that keeps `elsewhere` panels, the first ones, in memory of its own.
  void keep(std::uint32_t panels, std::uint32_t elsewhere = 0);
  [[nodiscard]] std::uint32_t kept() const { return kept_; }
  /// How many panels need not be read for a product, here or elsewhere.
  [[nodiscard]] std::uint32_t resident() const { return std::max(kept_, elsewhere_); }
  /// Bytes that the passes to come will still allocate.
  [[nodiscard]] std::uint64_t bytes_to_allocate() const;

  struct View {
    std::uint32_t panel = 0, first = 0, rows = 0;
    std::shared_ptr<const PageBuffer> memory;  ///< rows * stride floats, and maybe more
    bool stays = false;                        ///< the memory holds this panel in later passes, too
    [[nodiscard]] std::span<const float> row(std::uint32_t r, std::uint32_t stride) const {
      return {reinterpret_cast<const float*>(memory->data()) + std::size_t{r} * stride, stride};
    }
  };
  /// Calls `visit` once for each of the panels [from, end), in this thread, in some order. The memory is the caller's
  /// until visit returns. Throws what reading and visit throw; the thread that reads is gone when this returns, however
  /// it does.
  void pass(const std::function<void(const View&)>& visit, std::uint32_t from = 0, std::uint32_t end = all);
  static constexpr std::uint32_t all = 0xFFFFFFFF;

  struct Use {
    std::uint64_t passes = 0;
    std::uint64_t bytes_read = 0;
    double seconds_waiting = 0;  ///< of a caller, for a panel that was not there yet
  };
  [[nodiscard]] const Use& use() const { return use_; }

 private:
  class Reader;
  struct Slot {
    std::shared_ptr<PageBuffer> memory;
    std::optional<std::uint32_t> panel;  ///< what it holds
    std::uint64_t filled = 0;            ///< the higher the later
    bool taken = false;
  };

  [[nodiscard]] std::vector<std::uint32_t> order(std::uint32_t from, std::uint32_t end);

  const ExchangePanels& panels_;
  std::uint32_t fitting_ = 0, kept_ = 0, elsewhere_ = 0;
  std::vector<std::shared_ptr<PageBuffer>> stay_;  ///< by panel; null: not read yet
  std::vector<Slot> slots_;
  std::uint64_t fillings_ = 0;
  bool backwards_ = false;
  Use use_;
};

}  // namespace interflect
