#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "interflect/base/memory.h"
#include "interflect/formfactor/storage.h"

namespace interflect {

/// Rows [first, first + rows) of F: the unit of storage, upload, scheduling, saving and distribution.
struct Panel {
  std::uint32_t first = 0;
  std::uint32_t rows = 0;
  std::shared_ptr<PageBuffer>
      data;  ///< dense32: rows * stride floats, row-major; shared so that a device may use it in place
};

/// The form factors F_ij of N patches by panels: the share of what leaves i that arrives at j. Knows no device.
/// dense32: fp32, row-major, rows padded with zeros to a stride that is a multiple of 16 elements.
class FormFactorMatrix {
 public:
  FormFactorMatrix() = default;
  /// Allocates zeroed panels for n patches, none larger than max_panel_bytes (but at least one row each).
  /// Throws a limit Error when the system refuses the memory.
  explicit FormFactorMatrix(std::uint32_t n, std::uint64_t max_panel_bytes = default_panel_bytes());
  /// Only the rows [first, end) of such a matrix, for whoever makes or keeps one part by part: size() is n, and no
  /// other row may be asked for.
  [[nodiscard]] static FormFactorMatrix rows_only(std::uint32_t n, std::uint32_t first, std::uint32_t end);

  [[nodiscard]] std::uint32_t size() const { return n_; }
  [[nodiscard]] std::uint32_t stride() const { return stride_; }  ///< elements from one row to the next
  [[nodiscard]] Storage storage() const { return Storage::dense32; }
  [[nodiscard]] const std::vector<Panel>& panels() const { return panels_; }
  [[nodiscard]] std::uint32_t first_row() const { return first_; }  ///< 0 but for rows_only()
  [[nodiscard]] std::uint32_t end_row() const { return end_; }      ///< n but for rows_only()
  [[nodiscard]] std::uint64_t bytes() const;
  /// Share of the n² elements that are not zero and here.
  [[nodiscard]] double nonzero_fraction() const;

  /// Row i: n elements (the padding behind them is zero and not part of the span).
  [[nodiscard]] std::span<float> row(std::uint32_t i);
  [[nodiscard]] std::span<const float> row(std::uint32_t i) const;

  /// Σ_j F_ij for every i, summed in double.
  [[nodiscard]] std::vector<double> row_sums() const;

  /// The bytes that a matrix of n patches will take, before it is made.
  [[nodiscard]] static std::uint64_t predicted_bytes(std::uint64_t n);
  [[nodiscard]] static std::uint32_t stride_of(std::uint32_t n);
  /// 1 GiB, or INTERFLECT_MAX_PANEL_BYTES when set (so that tests can force many small panels).
  [[nodiscard]] static std::uint64_t default_panel_bytes();

 private:
  FormFactorMatrix(std::uint32_t n, std::uint32_t first, std::uint32_t end, std::uint64_t max_panel_bytes);

  std::uint32_t n_ = 0;
  std::uint32_t first_ = 0, end_ = 0;
  std::uint32_t stride_ = 0;
  std::uint32_t rows_per_panel_ = 0;
  std::vector<Panel> panels_;
};

}  // namespace interflect
