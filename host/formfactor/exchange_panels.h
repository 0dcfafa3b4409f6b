#pragma once

#include <cstdint>
#include <span>

#include "interflect/formfactor/panel_store.h"

namespace interflect {

/// The exchange areas S_ij = A_i F_ij of n patches, kept by panels somewhere else than in memory: panel k is the rows
/// [k * rows_per_panel, ...), whole rows of `stride` floats, the padding behind the n-th zero.
class ExchangePanels {
 public:
  ExchangePanels() = default;
  ExchangePanels(const ExchangePanels&) = delete;
  ExchangePanels& operator=(const ExchangePanels&) = delete;
  virtual ~ExchangePanels() = default;

  [[nodiscard]] virtual std::uint32_t size() const = 0;            ///< n, patches
  [[nodiscard]] virtual std::uint32_t stride() const = 0;          ///< from one row to the next, a multiple of 16
  [[nodiscard]] virtual std::uint32_t rows_per_panel() const = 0;  ///< of every panel but the last
  /// Fills `to` with a panel: its rows * stride floats. Called from one thread at a time, which need not be the
  /// maker's. Throws an input Error, naming file and panel, when it cannot be read or its checksum does not fit.
  virtual void read(std::uint32_t panel, std::span<float> to) const = 0;

  [[nodiscard]] std::uint32_t panels() const { return (size() + rows_per_panel() - 1) / rows_per_panel(); }
  [[nodiscard]] std::uint32_t rows(std::uint32_t panel) const {
    const std::uint32_t left = size() - panel * rows_per_panel();
    return left < rows_per_panel() ? left : rows_per_panel();
  }
};

/// A store whose panels are all there.
class StoredPanels final : public ExchangePanels {
 public:
  /// Of n patches. The store must outlive this.
  StoredPanels(const PanelStore& store, std::uint32_t n) : store_(store), n_(n) {}
  [[nodiscard]] std::uint32_t size() const override { return n_; }
  [[nodiscard]] std::uint32_t stride() const override { return FormFactorMatrix::stride_of(n_); }
  [[nodiscard]] std::uint32_t rows_per_panel() const override { return store_.rows_per_panel(); }
  void read(std::uint32_t panel, std::span<float> to) const override { store_.read_columns(panel, 0, stride(), to); }

 private:
  const PanelStore& store_;
  std::uint32_t n_;
};

}  // namespace interflect
