#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/formfactor/exchange_panels.h"

/// Panels that lie in memory and pretend to be a file.
namespace interflect::test {

class MemoryPanels final : public ExchangePanels {
 public:
  /// `element(i, j)` gives S.
  MemoryPanels(std::uint32_t n, std::uint32_t rows_per_panel,
               const std::function<float(std::uint32_t, std::uint32_t)>& element)
      : n_(n), rows_(rows_per_panel), data_(std::size_t{n} * MemoryPanels::stride()), reads(panels()) {
    for (std::uint32_t i = 0; i < n; ++i) {
      for (std::uint32_t j = 0; j < n; ++j) data_[std::size_t{i} * stride() + j] = element(i, j);
    }
  }
  [[nodiscard]] std::uint32_t size() const override { return n_; }
  [[nodiscard]] std::uint32_t stride() const override { return FormFactorMatrix::stride_of(n_); }
  [[nodiscard]] std::uint32_t rows_per_panel() const override { return rows_; }
  void read(std::uint32_t panel, std::span<float> to) const override {
    ++reads[panel];
    if (before_read) before_read(panel);
    if (to.size() != std::size_t{rows(panel)} * stride()) throw Error(ErrorKind::internal, "a panel of another size");
    const std::uint32_t from = instead ? instead(panel) : panel;
    const float* first = data_.data() + std::size_t{from} * rows_ * stride();
    const std::size_t there = std::size_t{std::min(rows(from), rows(panel))} * stride();
    std::copy_n(first, there, to.begin());
  }
  [[nodiscard]] float at(std::uint32_t i, std::uint32_t j) const { return data_[std::size_t{i} * stride() + j]; }
  [[nodiscard]] std::uint64_t panel_bytes() const { return std::uint64_t{rows(0)} * stride() * sizeof(float); }

 private:
  std::uint32_t n_, rows_;
  std::vector<float> data_;

 public:
  mutable std::vector<std::uint32_t> reads;                   ///< how often, by panel
  std::function<void(std::uint32_t panel)> before_read;       ///< may throw
  std::function<std::uint32_t(std::uint32_t panel)> instead;  ///< which panel is read in its place
};

/// Symmetric areas with zeros in them.
inline float wavy_element(std::uint32_t i, std::uint32_t j) {
  const auto [low, high] = std::minmax(i, j);
  return (low + high) % 5 == 0 ? 0.0F : (1.1F + std::sin(static_cast<float>(3 * low + 7 * high))) / 100.0F;
}

/// Keeps panels in memory, with their facts.
class MemoryStore final : public PanelStore {
 public:
  MemoryStore(std::uint32_t n, std::uint32_t rows_per_panel) : n_(n), rows_(rows_per_panel) {}
  [[nodiscard]] std::uint32_t rows_per_panel() const override { return rows_; }
  [[nodiscard]] bool has(std::uint32_t panel) const override { return panels.contains(panel); }
  void read_columns(std::uint32_t panel, std::uint32_t first, std::uint32_t columns,
                    std::span<float> to) const override {
    const std::vector<float>& rows = panels.at(panel).first;
    if (broken_columns && first > 0) first -= 1;
    for (std::size_t r = 0; r < rows.size() / stride(); ++r) {
      std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(r * stride() + first), columns,
                  to.begin() + static_cast<std::ptrdiff_t>(r * columns));
    }
  }
  [[nodiscard]] TileFacts load(std::uint32_t panel, FormFactorMatrix& s) override {
    const auto& [rows, facts] = panels.at(panel);
    for (std::uint32_t r = 0; r < rows.size() / stride(); ++r) {
      std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(r * stride()), n_, s.row(panel * rows_ + r).begin());
    }
    return facts;
  }
  void save(std::uint32_t panel, const FormFactorMatrix& s, const TileFacts& facts) override {
    const std::uint32_t first = panel * rows_, end = std::min(n_, first + rows_);
    std::vector<float> rows(std::size_t{end - first} * stride());
    for (std::uint32_t i = first; i < end; ++i) {
      std::copy_n(s.row(i).begin(), n_, rows.begin() + static_cast<std::ptrdiff_t>((i - first) * stride()));
    }
    panels[panel] = {std::move(rows), facts};
  }

  std::map<std::uint32_t, std::pair<std::vector<float>, TileFacts>> panels;
  bool broken_columns = false;  ///< columns come from the place one before theirs

 private:
  [[nodiscard]] std::size_t stride() const { return FormFactorMatrix::stride_of(n_); }
  std::uint32_t n_, rows_;
};

}  // namespace interflect::test
