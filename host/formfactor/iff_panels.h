#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "interflect/formfactor/exchange_panels.h"
#include "interflect/formfactor/iff_file.h"

namespace interflect {

/// The panels of a complete file. A panel's checksum is verified when it is first read, and not again: reading it for
/// every product shall cost no more than the disk takes.
class IffPanels final : public ExchangePanels {
 public:
  explicit IffPanels(IffFile file) : file_(std::move(file)), sound_(file_.panels()) {}
  [[nodiscard]] const IffFile& file() const { return file_; }
  [[nodiscard]] std::uint32_t size() const override { return file_.n(); }
  [[nodiscard]] std::uint32_t stride() const override { return file_.stride(); }
  [[nodiscard]] std::uint32_t rows_per_panel() const override { return file_.rows_per_panel(); }
  void read(std::uint32_t panel, std::span<float> to) const override {
    file_.read_panel(panel, to, !sound_.at(panel));
    if (sound_[panel]) return;
    nonzero_ += to.size() - static_cast<std::uint64_t>(std::count(to.begin(), to.end(), 0.0F));
    sound_[panel] = true;
  }
  /// Share of the n² elements that are not zero, once every panel has been read.
  [[nodiscard]] double nonzero_fraction() const {
    return static_cast<double>(nonzero_) / (static_cast<double>(size()) * static_cast<double>(size()));
  }

 private:
  IffFile file_;
  mutable std::uint64_t nonzero_ = 0;
  mutable std::vector<bool> sound_;  ///< those that were read: one thread at a time reads
};

}  // namespace interflect
